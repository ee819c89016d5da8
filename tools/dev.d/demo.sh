#: demo      find hidden errors of a simulated arm, compensate them over CAN, measure again
#:           (4 to 6 minutes from a bare machine)
# Runs the closed loop of sim/armtrue_loop with explanations; `./dev sil` runs it for other scenarios and modes, with
# longer moves.
cmd_demo() {
  say "the demo: install what it needs (1 minute, once), compile (2 to 4 minutes, once), run (1 minute)"
  install_packages run
  beside install_packages $(bus_packages)
  cmd_build
  say "an arm with errors that its owner does not know, on a CAN bus: controller, compensator, six drives, tracker"
  on_a_bus 1800 "$PY" -m armtrue_loop --out out/demo --move-cycles 4
  say "done: open out/demo/report.html (where it failed, what was missing) and out/demo/tool-error.svg (how the error fell)"
}
