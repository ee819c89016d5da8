#: mutants  put small faults into the firmware and list those that no unit test notices (--count 200; --part fitter|host_tools for those)
cmd_mutants() {
  install_packages run unit test bench
  ensure_venv build run test
  case " $* " in
    *" --part host_tools "*) nice -n 10 $PY tools/mutants.py "$@" ;;
    *) nice -n 10 $PY tools/cpp_mutants.py "$@" ;;
  esac
}
