# Times of a diagnosis over the whole catalogue and of a refinement, and their growth with the data.
OPENBLAS_NUM_THREADS=1 $PY tools/into_results.py "diagnosis speed" $PY tests/speed/diagnosis_speed.py
