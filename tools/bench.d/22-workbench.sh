# Time from a click on the workbench to the figures, in Debian's Chromium (takes 10 minutes), and memory of the
# workbench (takes an hour); into docs/results.md.
$PY tools/into_results.py workbench $PY tests/workbench/click_to_figures.py
$PY tools/into_results.py "workbench memory" $PY tests/workbench/memory.py
