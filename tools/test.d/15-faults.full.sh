# Fault tests, with the number of tries of each: power cuts and failed flash operations; transfers of every size, and
# disturbed ones; an hour of simulated 1 kHz motion with random faults of every kind, in both modes, with synchronous
# and asynchronous targets; hours with drives that do not always follow (states, homing, hand-guiding, other tables, an
# axis without end stops).
build_preset release firmware_hours
$PY tests/firmware/faults/faults_report.py build/release
