# A fresh clone on a bare Debian 12: seconds to the demo's figures, and to the verdict of the tests. Half an hour, with nothing beside it.
$PY tools/into_results.py "clone" $PY tests/speed/from_a_clone.py
