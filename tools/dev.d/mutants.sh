#: mutants  put small faults into the code one at a time and list those that no test notices (--part firmware|fitter|host_tools --count 200)
cmd_mutants() {
  install_packages run test bench
  ensure_venv run test
  nice -n 10 $PY tools/mutants.py "$@"
}
