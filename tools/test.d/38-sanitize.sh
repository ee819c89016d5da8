# The fitter's unit tests under the address and undefined-behaviour sanitizers; those that only repeat a diagnosis many
# times run without.
[ -f build/sanitize/build.ninja ] || cmake --preset sanitize >/dev/null
cmake --build build/sanitize --target fitter_test -j "$JOBS"
# Ceres comes from Debian without sanitizers, so containers that cross into it cannot be annotated.
export ASAN_OPTIONS=detect_container_overflow=0:strict_string_checks=1 UBSAN_OPTIONS=print_stacktrace=1 GTEST_TOTAL_SHARDS=$JOBS
seq 0 $((JOBS - 1)) | xargs -P "$JOBS" -I{} env GTEST_SHARD_INDEX={} build/sanitize/fitter/fitter_test --gtest_brief=1 \
  --gtest_filter='-Scorer.Probabilities*:Structure.OfNoise*:Diagnose.SaysNothing*:Fit.HonestRows*:Refine.AProxy*'
