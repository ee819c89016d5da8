# The node under address and undefined-behaviour sanitizers: its unit tests, and 20 s of fuzzing by
# frame sequences from the committed corpus.
cmake --preset fuzz -B build/fuzz-can -DARMTRUE_SANITIZE=ON >/dev/null
cmake --build build/fuzz-can -j "$JOBS" --target canopen_test canopen_fuzz
build/fuzz-can/firmware/canopen/canopen_test --gtest_brief=1
mkdir -p out/fuzz-can
build/fuzz-can/firmware/canopen/canopen_fuzz -max_total_time="${ARMTRUE_FUZZ_SECONDS:-20}" -max_len=2048 \
  -artifact_prefix=out/fuzz-can/ -print_final_stats=1 out/fuzz-can firmware/canopen/fuzz/corpus \
  >out/fuzz-can.log 2>&1 || { tail -40 out/fuzz-can.log; false; }
grep -E "number_of_executed_units|new_units_added" out/fuzz-can.log
