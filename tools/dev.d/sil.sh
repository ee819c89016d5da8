#: sil       the loop in software, over CAN: measure, fit, find, upload, measure again ([SCENARIO] [--mode offset])
# Natively where the kernel has AF_CAN, else inside User-Mode Linux; no bus at all is a failure.
on_a_bus() {
  PYTHONPATH=$ROOT/sim COLUMNS=${COLUMNS:-$(tput cols 2>/dev/null || echo 120)} LINES=${LINES:-50} $PY -m rig --timeout "$1" -- "${@:2}"
}

# The list of packages that buses need here: none where the kernel has AF_CAN, as /usr/bin/python3 sees it.
bus_packages() {
  /usr/bin/python3 -c 'import socket; socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)' 2>/dev/null || echo bus
}

cmd_sil() {
  install_packages run $(bus_packages)
  cmd_build
  mkdir -p out
  on_a_bus 1800 "$PY" -m armtrue_loop --out out/sil "$@"
}
