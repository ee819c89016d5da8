# The loop's figures over CAN, in both modes.
for mode in inline offset; do
  on_a_bus 1800 "$PY" -m armtrue_loop --out "out/bench-loop-$mode" --mode "$mode"
done
$PY tools/into_results.py loop bash -c 'cat "$1"; echo; cat "$2"' - out/bench-loop-{inline,offset}/tool-error.md
