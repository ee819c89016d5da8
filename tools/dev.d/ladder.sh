#: ladder    the IRB2400 paper's ladder of models on the simulated arm; tables into docs/results.md
cmd_ladder() {
  cmd_build
  OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests/ladder $PY tools/into_results.py ladder $PY tests/ladder/ladder.py "$@"
}
