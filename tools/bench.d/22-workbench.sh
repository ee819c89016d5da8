# From a click on the workbench to the figures, in Debian's Chromium (10 minutes), and its memory (an hour); into
# docs/results.md.
$PY tools/into_results.py workbench $PY tests/workbench/click_to_figures.py
$PY tools/into_results.py "workbench memory" $PY tests/workbench/memory.py
