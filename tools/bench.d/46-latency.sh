# How late SYNC and targets leave the STM32F405's node.
$PY tools/into_results.py latency $PY tests/firmware/latency_report.py
