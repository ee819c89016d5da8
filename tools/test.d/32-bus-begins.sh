# Starts the Python tests with a bus or an emulated chip, and the closed loop in both modes, in the background: they
# mostly wait for frames. The later steps run at lower priority meanwhile. Step 50 waits for these tests and prints
# their output.
mkdir -p out
# begin_apart NAME ARGUMENT...: pytest in the background, with output and exit status in out/pytest-NAME.log and
# .status.
begin_apart() {
  rm -f "out/pytest-$1.status"
  (
    status=0
    ARMTRUE_RIG_TIMEOUT=900 OPENBLAS_NUM_THREADS=1 run_pytest "${@:2}" tests/can tests/loop tests/firmware_boot \
      >"out/pytest-$1.log" 2>&1 || status=$?
    echo $status >"out/pytest-$1.status"
  ) </dev/null >/dev/null 2>&1 &
}
begin_apart bus -m "on_bus${LEVEL_MARK:+ and $LEVEL_MARK}"
begin_apart chip -m "not on_bus${LEVEL_MARK:+ and $LEVEL_MARK}" -n 2 --dist loadfile
# Lowers the priority of the rest of this run, not of the tests just started. The autogroup's priority is lowered
# because User-Mode Linux runs in a session of its own.
renice -n 10 -p $$ >/dev/null
{ echo 10 >/proc/self/autogroup; } 2>/dev/null || true
