# A simulated campaign in memory (asked for: 50 ms), and a large CSV read (about a second).
OPENBLAS_NUM_THREADS=1 $PY tools/into_results.py "data speed" $PY tests/speed/data_speed.py
