# Python unit tests beside their subject, and the tests across parts; then the verdict of those that step 32 began.
# (-rs: a test that cannot run here, for want of ../shared/datasets, says so.)
OPENBLAS_NUM_THREADS=1 run_pytest -n "$JOBS" --dist loadfile host_tools sim tests \
  --ignore=tests/can --ignore=tests/loop --ignore=tests/firmware_boot --ignore=tests/wheel && others=0 || others=$?
if [ -e tools/test.d/32-bus-begins.sh ] && [ ! -e out/pytest-bus.log ]; then
  (. tools/test.d/32-bus-begins.sh)  # this step alone was asked for
fi
waited=0
until [ -e out/pytest-bus.status ]; do
  sleep 2
  waited=$((waited + 2))
  [ $waited -lt 1200 ] || { echo "the tests with a bus did not end within 20 minutes" >&2; break; }
done
cat out/pytest-bus.log
bus=$(cat out/pytest-bus.status 2>/dev/null || echo 1)
rm -f out/pytest-bus.status out/pytest-bus.log
[ "$others" = 0 ] && [ "$bus" = 0 ]
