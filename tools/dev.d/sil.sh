#: sil       closed loop in software, over CAN: measure, fit, diagnose, upload, measure again
#:           ([SCENARIO] [--mode offset])
# on_a_bus SECONDS COMMAND...: runs COMMAND with CAN buses: those of the kernel if it has AF_CAN, else inside User-Mode
# Linux. If neither is possible, it fails.
on_a_bus() {
  PYTHONPATH=$ROOT/sim COLUMNS=${COLUMNS:-$(tput cols 2>/dev/null || echo 120)} LINES=${LINES:-50} $PY -m rig --timeout "$1" -- "${@:2}"
}

# Prints the package list that CAN buses need on this machine: none if /usr/bin/python3 can open an AF_CAN socket.
bus_packages() {
  /usr/bin/python3 -c 'import socket; socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)' 2>/dev/null || echo bus
}

cmd_sil() {
  install_packages run $(bus_packages)
  cmd_build
  mkdir -p out
  on_a_bus 1800 "$PY" -m armtrue_loop --out out/sil "$@"
}
