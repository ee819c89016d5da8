# Time of an upload compared with the limit of the protocol, and instructions of a Cortex-M4 cycle with the CAN path;
# into docs/results.md.
build_preset stm32f405 >/dev/null
mkdir -p out
on_a_bus 300 "$PY" tests/can/bench.py transfer out/bench-can.json
$PY tools/into_results.py can $PY tests/can/bench.py report out/bench-can.json
