# What happens when things go wrong, and how often it was tried: power cuts and failed operations of the flash, transfers of every
# size and disturbed ones, an hour of simulated 1 kHz motion with every fault at random, in both modes, with targets that wait for SYNC
# and that do not; and hours with drives that do not always follow: states, homing, hand-guiding, other tables, an axis without end.
build_preset release firmware_hours
$PY tests/firmware/faults/faults_report.py build/release
