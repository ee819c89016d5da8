#: format    lay out all code as the checks want it (ruff, clang-format)
cpp_sources() { find fitter firmware -name '*.h' -o -name '*.cc' -o -name '*.cpp' | sort; }

cmd_format() {
  install_packages run lint
  ensure_venv run lint
  $PY -m ruff format
  $PY -m ruff check --fix
  cpp_sources | xargs clang-format-14 -i
}
