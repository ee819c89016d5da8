#: demo      from nothing to the main job's result: an arm with hidden errors found out, compensated, measured again over CAN
# The loop of sim/armtrue_loop as a newcomer's story; `./dev sil` is the same for other scenarios and modes.
cmd_demo() {
  cmd_build
  say "an arm with errors that its owner does not know, on a CAN bus: controller, compensator, six drives, tracker"
  on_a_bus 1800 "$PY" -m armtrue_loop --out out/demo
  say "done: open out/demo/report.html (where it failed, what was missing) and out/demo/tool-error.svg (how the error fell)"
}
