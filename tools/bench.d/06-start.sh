# What `armtrue --version` and `--help` take (asked for: 150 ms).
$PY tools/into_results.py "start" $PY tests/speed/start_speed.py
