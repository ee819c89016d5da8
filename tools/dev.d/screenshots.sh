#: screenshots  make docs/screenshots of a report again (Debian's Chromium)
cmd_screenshots() {
  cmd_build
  $PY tests/report/screenshots.py "$@"
}
