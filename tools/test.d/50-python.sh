# Python unit tests beside the code that they test, and the tests across parts; then the results of the tests that step
# 32 started. There is one worker more than cores, since many tests wait for a command, a browser or a disk. pytest
# prints which tests were skipped and why: those on real measurements, if ../shared/datasets is missing.
OPENBLAS_NUM_THREADS=1 run_pytest ${LEVEL_MARK:+-m "$LEVEL_MARK"} -n $((JOBS + 1)) --dist loadfile host_tools sim tests \
  --ignore=tests/can --ignore=tests/loop --ignore=tests/firmware_boot --ignore=tests/wheel && failed=0 || failed=1
if [ ! -e out/pytest-bus.log ]; then
  (. tools/test.d/32-bus-begins.sh)  # step 32 has not run: only this step was requested
fi
waited=0
until [ -e out/pytest-bus.status ] && [ -e out/pytest-chip.status ]; do
  sleep 2
  waited=$((waited + 2))
  [ $waited -lt 1200 ] || { echo "the tests with a bus or a chip did not end within 20 minutes" >&2; break; }
done
for apart in chip bus; do
  cat out/pytest-$apart.log
  [ "$(cat out/pytest-$apart.status 2>/dev/null)" = 0 ] || failed=1
  rm -f out/pytest-$apart.status out/pytest-$apart.log
done
[ $failed = 0 ]
