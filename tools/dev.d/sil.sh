#: sil       the loop in software, over CAN: measure, fit, find, upload, measure again ([SCENARIO] [--mode offset])
# Natively where the kernel has AF_CAN, else inside User-Mode Linux; no bus at all is a failure.
on_a_bus() {
  PYTHONPATH=$ROOT/sim COLUMNS=${COLUMNS:-$(tput cols 2>/dev/null || echo 120)} LINES=${LINES:-50} $PY -m rig --timeout "$1" -- "${@:2}"
}

cmd_sil() {
  cmd_build
  ensure_sim
  mkdir -p out
  on_a_bus 1800 "$PY" -m armtrue_loop --out out/sil "$@"
}
