# C++ unit tests of the firmware, release build. (The fitter's run in step 38.)
ctest --test-dir build/release/firmware --output-on-failure -j "$JOBS"
