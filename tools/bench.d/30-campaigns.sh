# What takes long and is no matter of speed: the paper's experiment, all hidden-effect cases, the real arm, the ladder, planned poses.
OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests/truth $PY tests/truth/paper.py | $PY tools/into_results.py paper
PYTHONPATH=tests/truth OPENBLAS_NUM_THREADS=1 $PY tests/truth/repetitions.py | $PY tools/into_results.py sigma
for campaign in hidden ur10 ladder plan; do say "bench: $campaign"; "cmd_$campaign"; done
