#: format    format all code as the checks require (ruff, clang-format)
cpp_sources() { find fitter firmware -name '*.h' -o -name '*.cc' -o -name '*.cpp' | sort; }

cmd_format() {
  install_packages run
  ensure_venv lint
  $PY -m ruff format
  $PY -m ruff check --fix
  cpp_sources | xargs .venv/bin/clang-format -i
}
