# A fresh clone on a bare Debian 12: time to the figures of the demo, and to the verdict of the tests. Takes half an
# hour; run nothing else meanwhile.
$PY tools/into_results.py "clone" $PY tests/speed/from_a_clone.py
