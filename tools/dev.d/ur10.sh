#: ur10      the real UR10 of ../shared/datasets, errors on held-out poses; its table goes into docs/results.md
cmd_ur10() {
  cmd_build
  local keep=()
  [ $# != 0 ] || keep=("$PY" tools/into_results.py ur10)  # a part of the table is only shown
  OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests/real_arm "${keep[@]}" $PY tests/real_arm/ur10.py "$@"
}
