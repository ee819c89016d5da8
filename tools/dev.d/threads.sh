#: threads   the fits, refits and swaps that run side by side, under ThreadSanitizer
# LAPACK and Ceres come from Debian without it: what they do among themselves is not seen, nor asked about.
cmd_threads() {
  install_packages run unit test full
  ensure_venv build run test
  build_preset threads fitter_test
  TSAN_OPTIONS="halt_on_error=1 ignore_noninstrumented_modules=1" build/threads/fitter/fitter_test --gtest_brief=1 \
    --gtest_filter="${1:-Diagnose.*:Refine.*:InParallel.*:Fit.*:State.*:Structure.*}"
}
