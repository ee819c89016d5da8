# The node under address and undefined-behaviour sanitizers: its unit tests. (Step 39 fuzzes it.)
cmake --preset fuzz -B build/fuzz-can -DARMTRUE_SANITIZE=ON >/dev/null
cmake --build build/fuzz-can -j "$JOBS" --target canopen_test
build/fuzz-can/firmware/canopen/canopen_test --gtest_brief=1
