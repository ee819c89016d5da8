# What happens when things go wrong, and how often it was tried: power cuts and failed operations of the flash, transfers of every
# size, an hour of simulated 1 kHz motion with every fault at random (and one with targets that wait for SYNC).
build/release/firmware/storage/storage_test --gtest_filter='PowerCut.*' --gtest_brief=1
build/release/firmware/ports/common/ports_common_test --gtest_filter='NodePowerCut.*' --gtest_brief=1
build/release/firmware/canopen/canopen_sizes
build/release/firmware/canopen/canopen_soak 3600 1 1 &
soak=$!
build/release/firmware/canopen/canopen_soak 3600 2 1 sync
wait $soak
