# All other host tests of the firmware under address and undefined-behaviour sanitizers, and 20 s of fuzzing the table
# reader and the joint path of whatever it accepts (step 36 has built the same folder for the node).
cmake --preset fuzz -B build/fuzz-can -DARMTRUE_SANITIZE=ON >/dev/null
cmake --build build/fuzz-can -j "$JOBS" \
  --target firmware_core_test storage_test ports_common_test stm32f405_test r5f_test table_fuzz
# All pairs of power cuts are the same code 70 000 times: step 15 does them without sanitizers.
build/fuzz-can/firmware/storage/storage_test --gtest_brief=1 --gtest_filter='-PowerCut.AtEveryPairOfOperations' &
storage=$!
for part in core/firmware_core_test ports/common/ports_common_test ports/stm32f405/stm32f405_test ports/r5f/r5f_test; do
  build/fuzz-can/firmware/$part --gtest_brief=1
done
wait $storage
mkdir -p out/fuzz-table
build/fuzz-can/firmware/core/table_fuzz -max_total_time="${ARMTRUE_FUZZ_SECONDS:-20}" -max_len=16385 \
  -artifact_prefix=out/fuzz-table/ -print_final_stats=1 out/fuzz-table firmware/core/fuzz/corpus \
  >out/fuzz-table.log 2>&1 || { tail -40 out/fuzz-table.log; false; }
grep -E "number_of_executed_units|new_units_added" out/fuzz-table.log
