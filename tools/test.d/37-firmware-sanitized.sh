# All other host tests of the firmware under address and undefined-behaviour sanitizers.
build_preset sanitize firmware_core_test storage_test ports_common_test stm32f405_test r5f_test
# All pairs of power cuts are the same code 70 000 times: step 15 does them without sanitizers.
build/sanitize/firmware/storage/storage_test --gtest_brief=1 --gtest_filter='-PowerCut.AtEveryPairOfOperations' &
storage=$!
for part in core/firmware_core_test ports/common/ports_common_test ports/stm32f405/stm32f405_test ports/r5f/r5f_test; do
  build/sanitize/firmware/$part --gtest_brief=1
done
wait $storage
