#: ur10      errors of the real UR10 of ../shared/datasets on held-out poses; table into docs/results.md
cmd_ur10() {
  cmd_build
  local keep=()
  [ $# != 0 ] || keep=("$PY" tools/into_results.py ur10)  # with options, the table is incomplete and only printed
  OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests/real_arm "${keep[@]}" $PY tests/real_arm/ur10.py "$@"
}
