# Upload against the protocol's own limit, the M4's cycle with the CAN path, latency through the POSIX node.
# The tables go into docs/results.md.
build_preset stm32f405 >/dev/null
mkdir -p out/bench-can
for part in transfer latency; do
  on_a_bus 300 "$PY" tests/can/bench.py "$part" "out/bench-can/$part.json"
done
$PY tools/into_results.py can $PY tests/can/bench.py report out/bench-can
