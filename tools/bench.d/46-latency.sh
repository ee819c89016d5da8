# Delay of SYNC and targets in the STM32F405 node.
$PY tools/into_results.py latency $PY tests/firmware/latency_report.py
