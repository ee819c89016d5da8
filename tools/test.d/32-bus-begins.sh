# The Python tests with a bus or an emulated chip, and the loop in both modes, mostly wait for each other's frames: they begin
# here and run beside what compiles and computes, which steps back for them; step 50 waits for them and shows what they printed.
mkdir -p out
# begin_apart NAME ARGUMENT...: pytest in the background; its output and its status are files out/pytest-NAME.*.
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
# This whole run from here on, not what has just begun; autogroup: against the User-Mode Linux, a session of its own.
renice -n 10 -p $$ >/dev/null
{ echo 10 >/proc/self/autogroup; } 2>/dev/null || true
