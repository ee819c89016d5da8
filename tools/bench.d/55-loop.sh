# The loop's figures over CAN, inline.
ensure_sim
on_a_bus 1800 "$PY" -m armtrue_loop --out out/bench-loop
$PY tools/into_results.py loop <out/bench-loop/tool-error.md
