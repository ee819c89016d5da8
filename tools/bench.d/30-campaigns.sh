# Long campaigns that do not measure speed: the paper's experiment, all hidden-effect cases, the real arm, the ladder,
# planned poses.
export OPENBLAS_NUM_THREADS=1
PYTHONPATH=tests/truth $PY tools/into_results.py paper $PY tests/truth/paper.py
PYTHONPATH=tests/truth $PY tools/into_results.py sigma $PY tests/truth/repetitions.py
for campaign in hidden ur10 ladder plan; do say "bench: $campaign"; "cmd_$campaign"; done
