# The STM32F405 image compared with its budgets, the faults of step 15 of ./dev test, and the error that remains on
# simulated arms after fixed-point compensation; into docs/results.md.
build_preset stm32f405 >/dev/null
build_preset release firmware_tests firmware_hours >/dev/null
$PY tools/into_results.py stm32f405 $PY tests/firmware/firmware_report.py table
$PY tools/into_results.py faults $PY tests/firmware/faults/faults_report.py build/release
rows=$($PY -m pytest -q -s -p no:cacheprovider tests/firmware/test_truth.py |
  sed -nE 's/^\.*([a-z0-9]+), deflected: uncorrected ([0-9]+) µm, compensated ([0-9.]+) µm, fit ([0-9.]+) µm$/| \1 | \2 | \3 | \4 |/p')
$PY tools/into_results.py truth printf '%s\n' "| arm | uncorrected [µm] | compensated [µm] | the fit's own [µm] |" '|---|---|---|---|' "$rows"
