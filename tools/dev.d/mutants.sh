#: mutants   mutation testing of the firmware: list changes that no unit test notices
#:           (--count 200; --part fitter|host_tools)
cmd_mutants() {
  install_packages run unit test bench
  ensure_venv build run test
  case " $* " in
    *" --part host_tools "*) nice -n 10 $PY tools/python_mutants.py "$@" ;;
    *) nice -n 10 $PY tools/cpp_mutants.py "$@" ;;
  esac
}
