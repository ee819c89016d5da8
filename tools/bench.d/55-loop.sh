# The loop's figures over CAN, in both modes.
ensure_sim
for mode in inline offset; do
  on_a_bus 1800 "$PY" -m armtrue_loop --out "out/bench-loop-$mode" --mode "$mode"
done
{ cat out/bench-loop-inline/tool-error.md; echo; cat out/bench-loop-offset/tool-error.md; } | $PY tools/into_results.py loop
