# The loop closed over CAN in both modes: measure, fit, diagnose, add, export, upload, measure again. Fails if the tool
# error over CAN, compensated by the effects found, is more than 1.05 times the double-precision prediction, if the
# effects found are not the hidden ones, or if the controller saw a following error. (The CAN tests run with the Python
# tests.)
for mode in inline offset; do
  on_a_bus 900 "$PY" -m armtrue_loop --out "out/sil-test-$mode" --mode "$mode" --move-cycles 6
done
