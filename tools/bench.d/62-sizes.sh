# Transfers by a third-party client (PyPI canopen): every size up to 512 bytes, then every 509th up to the largest
# table.
on_a_bus 1200 "$PY" tests/can/sweep_sizes.py
# Every size, on a bus inside the process, which has no delay and loses no frame; into docs/results.md.
$PY tools/into_results.py "foreign sizes" $PY tests/can/every_size.py --jobs "$JOBS"
