# The fitter's unit tests, then whole campaigns, under address and undefined-behaviour sanitizers.
build_preset sanitize fitter_test
# Debian's Ceres is not instrumented, so containers passed to it would cause false reports of container overflows.
export ASAN_OPTIONS=detect_container_overflow=0:strict_string_checks=1 UBSAN_OPTIONS=print_stacktrace=1 GTEST_TOTAL_SHARDS=$JOBS
seq 0 $((JOBS - 1)) | xargs -P "$JOBS" -I{} env GTEST_SHARD_INDEX={} build/sanitize/fitter/fitter_test --gtest_brief=1
# Unit tests do not cover all combinations of effects, springs and masses of a search. So one campaign of every hidden
# kind runs through the command line, on a copy of the package with the sanitized module. Leaks are not checked, because
# Python does not free all of its memory before it exits.
configure sanitize -DARMTRUE_PYTHON=ON
build_preset sanitize armtrue_core_python
package=build/sanitize/python
rm -rf $package && mkdir -p $package && cp -r host_tools/armtrue $package/
rm -f $package/armtrue/_core*.so && cp build/sanitize/fitter/python/_core*.so $package/armtrue/
ASAN_OPTIONS=$ASAN_OPTIONS:detect_leaks=0 LD_PRELOAD=$(clang++-14 -print-file-name=libclang_rt.asan-x86_64.so) OPENBLAS_NUM_THREADS=1 \
  PYTHONPATH=$package:tests/hidden_effects $PY tests/hidden_effects/campaign.py each --no-reference --limit 1200 --jobs "$JOBS"
