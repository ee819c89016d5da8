#: mutants  change the firmware in one place at a time and list the changes that no unit test notices (--count 200; --part fitter|host_tools for those)
cmd_mutants() {
  install_packages run unit test bench
  ensure_venv build run test
  case " $* " in
    *" --part host_tools "*) nice -n 10 $PY tools/python_mutants.py "$@" ;;
    *) nice -n 10 $PY tools/cpp_mutants.py "$@" ;;
  esac
}
