# C++ unit tests of the firmware, release build. What is the same code tens of thousands of times is left to the full run,
# whose step 15 counts it: pairs of power cuts, those of the largest table, those under a whole node, the soak.
[ $LEVEL = full ] && left_out='^$' || left_out='PairOfOperations|OperationOfTheLargestTable|NodePowerCut|Soak'
ctest --test-dir build/release/firmware --output-on-failure -j "$JOBS" -E "$left_out"
