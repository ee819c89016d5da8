# Time of `armtrue --version` and `--help` (required: 150 ms).
$PY tools/into_results.py "start" $PY tests/speed/start_speed.py
