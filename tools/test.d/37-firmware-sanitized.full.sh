# All other host tests of the firmware under address and undefined-behaviour sanitizers.
build_preset sanitize firmware_core_test senseless_tables storage_test ports_common_test posix_test stm32f405_test r5f_test
# Tests of power cuts in pairs, with the largest table and under a whole node run the same code tens of thousands of
# times: step 15 runs them without sanitizers.
often='PowerCut.AtEveryPairOfOperations:PowerCut.AtEveryOperationOfTheLargestTable:NodePowerCut.TheDrivesGetTheOldTableOrTheNewOne'
build/sanitize/firmware/storage/storage_test --gtest_brief=1 --gtest_filter="-$often" &
storage=$!
for part in core/firmware_core_test ports/common/ports_common_test ports/posix/posix_test ports/stm32f405/stm32f405_test ports/r5f/r5f_test; do
  build/sanitize/firmware/$part --gtest_brief=1 --gtest_filter="-$often"
done
# Random tables that follow the format but have no physical meaning; tests/firmware/test_senseless.py runs such tables
# on the emulated chip.
build/sanitize/firmware/core/senseless_tables 0 10000
wait $storage
