#: ur10      the real UR10 of ../shared/datasets, errors on held-out poses; its table goes into docs/results.md
cmd_ur10() {
  cmd_build
  OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests/real_arm $PY tests/real_arm/ur10.py "$@" |
    if [ $# = 0 ]; then $PY tools/into_results.py ur10; else cat; fi  # a part of the table is only shown
}
