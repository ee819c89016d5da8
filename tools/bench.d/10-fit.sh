# Time of a fit compared with scipy and pybotics, its growth with the data, and the times of its parts (Google
# Benchmark).
if [ ! -x .venv-bench/bin/python ]; then
  /usr/bin/python3 -m venv .venv-bench
  .venv-bench/bin/python -m pip install --quiet --disable-pip-version-check -r tools/requirements/bench.txt
fi
OPENBLAS_NUM_THREADS=1 $PY tools/into_results.py "fit speed" $PY tests/speed/fit_speed.py --rivals .venv-bench/bin/python
build_preset bench >/dev/null
build/bench/fitter/fitter_bench --benchmark_min_time=0.5 --benchmark_color=false
