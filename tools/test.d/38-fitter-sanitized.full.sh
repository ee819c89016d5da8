# The fitter's unit tests, under address and undefined-behaviour sanitizers.
build_preset sanitize fitter_test
# Ceres comes from Debian without sanitizers, so containers that cross into it cannot be annotated.
export ASAN_OPTIONS=detect_container_overflow=0:strict_string_checks=1 UBSAN_OPTIONS=print_stacktrace=1 GTEST_TOTAL_SHARDS=$JOBS
seq 0 $((JOBS - 1)) | xargs -P "$JOBS" -I{} env GTEST_SHARD_INDEX={} build/sanitize/fitter/fitter_test --gtest_brief=1
