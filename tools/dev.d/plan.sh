#: plan      planned poses compared with random ones on simulated arms; tables into docs/results.md
cmd_plan() {
  cmd_build
  OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests/planning $PY tools/into_results.py plan $PY tests/planning/trial.py "$@"
}
