#: screenshots  update docs/screenshots: a report and the workbench, in Debian's Chromium
cmd_screenshots() {
  install_packages run test
  cmd_build
  ensure_venv run test
  $PY tests/report/screenshots.py "$@"
  $PY tests/workbench/screenshots.py
}
