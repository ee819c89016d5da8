# C++ unit tests of the firmware, release build. CMake leaves out the longest power-cut campaigns, which step 15 of the
# full run has.
ctest --test-dir build/release/firmware --output-on-failure -j "$JOBS"
