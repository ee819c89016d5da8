# Fixed point compared with double precision at 100 000 random poses of each arm, into docs/results.md; the fixed-point
# sine at all 2^32 angles.
$PY tools/into_results.py fixed $PY tests/firmware/accuracy_report.py --jobs "$JOBS"
[ -f build/bench/build.ninja ] || cmake --preset bench >/dev/null
cmake --build build/bench -j "$JOBS" --target exhaustive >/dev/null
build/bench/firmware/core/exhaustive
