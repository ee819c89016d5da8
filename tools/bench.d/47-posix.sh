# Delay of targets in the POSIX node, as an ordinary process and under SCHED_FIFO (which needs root).
$PY tools/into_results.py "posix latency" $PY tests/can/realtime_latency.py
