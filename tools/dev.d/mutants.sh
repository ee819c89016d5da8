#: mutants  put small faults into core, canopen and storage one at a time and list those that no unit test notices (--count 200 --seed 1)
cmd_mutants() {
  install_packages run test
  ensure_venv run test
  nice -n 10 $PY tools/mutants.py "$@"
}
