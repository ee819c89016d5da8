#: record    record what the fitter says of small campaigns (tests/recorded), after a change that is meant to alter it
cmd_record() {
  cmd_build
  OPENBLAS_NUM_THREADS=1 $PY tests/recorded/fitter_results.py
  git diff --stat tests/recorded
}
