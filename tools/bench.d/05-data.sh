# Time to simulate a campaign in memory (required: 50 ms) and to read a large CSV (about a second).
OPENBLAS_NUM_THREADS=1 $PY tools/into_results.py "data speed" $PY tests/speed/data_speed.py
