# C++ unit tests of the firmware, release build. Pairs of power cuts and those of the largest table are the same code tens of
# thousands of times: they are left to the full run, whose step 15 counts them.
[ $LEVEL = full ] && left_out='^$' || left_out='PairOfOperations|OperationOfTheLargestTable'
ctest --test-dir build/release/firmware --output-on-failure -j "$JOBS" -E "$left_out"
