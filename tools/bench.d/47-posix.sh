# How late the POSIX node's targets leave it, as an ordinary process and under SCHED_FIFO. (Needs root for the latter.)
$PY tools/into_results.py "posix latency" $PY tests/can/realtime_latency.py
