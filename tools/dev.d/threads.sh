#: threads   tests of the fitter that run in parallel threads, under ThreadSanitizer
# Debian's LAPACK and Ceres are not instrumented: data races inside them are neither detected nor reported.
cmd_threads() {
  install_packages run unit test full
  ensure_venv build run test
  build_preset threads fitter_test
  TSAN_OPTIONS="halt_on_error=1 ignore_noninstrumented_modules=1" build/threads/fitter/fitter_test --gtest_brief=1 \
    --gtest_filter="${1:-Diagnose.*:Refine.*:InParallel.*:Fit.*:State.*:Structure.*}"
}
