# The catalogue's time and growth, and a refinement's.
OPENBLAS_NUM_THREADS=1 $PY tools/into_results.py "diagnosis speed" $PY tests/speed/diagnosis_speed.py
