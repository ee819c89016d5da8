# From a fresh clone of HEAD to the demo's figures and to the verdict of the tests; half an hour, with nothing beside it.
$PY tools/into_results.py "clone" $PY tests/speed/from_a_clone.py
