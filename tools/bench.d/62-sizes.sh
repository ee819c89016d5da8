# Transfers by a client that nobody here wrote (PyPI canopen): every size up to 512 bytes, then every 509th up to the largest table.
on_a_bus 1200 "$PY" tests/can/sweep_sizes.py
# Every size, on a bus inside the process, which neither waits nor loses anything; into docs/results.md.
$PY tools/into_results.py "foreign sizes" $PY tests/can/every_size.py --jobs "$JOBS"
