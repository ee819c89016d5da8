# C++ unit tests, release build.
ctest --test-dir build/release --output-on-failure -j "$JOBS"
