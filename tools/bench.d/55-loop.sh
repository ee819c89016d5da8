# Errors of the closed loop over CAN, in both modes.
for mode in inline offset; do
  on_a_bus 1800 "$PY" -m armtrue_loop --out "out/bench-loop-$mode" --mode "$mode"
done
# The first line names the mode. Offset mode is printed only if its figures differ.
$PY tools/into_results.py loop bash -c '
  cat "$1"; echo
  if cmp -s <(tail -n +2 "$1") <(tail -n +2 "$2"); then echo "Offset mode: the same figures."; else cat "$2"; fi
' - out/bench-loop-{inline,offset}/tool-error.md
