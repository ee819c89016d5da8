# A minute of libFuzzer over what the C++ core parses, on both at once: expressions, and the JSON of robots and terms.
[ -f build/fuzz/build.ninja ] || cmake --preset fuzz >/dev/null
cmake --build build/fuzz --target fitter_fuzz -j "$JOBS"
fuzz_one() {
  mkdir -p "build/fuzz/found/$1"
  "build/fuzz/fitter/$1_fuzz" "build/fuzz/found/$1" "tests/fuzz/corpus/$2" -max_total_time=30 -timeout=10 \
    -rss_limit_mb=2048 -max_len=4096 -seed=1 -dict=tests/fuzz/tokens.dict -print_final_stats=1 >"build/fuzz/found/$1.log" 2>&1 ||
    { tail -40 "build/fuzz/found/$1.log"; return 1; }
  grep -E "number_of_executed_units|new_units_added" "build/fuzz/found/$1.log"
}
fuzz_one expression expression &
first=$!
fuzz_one json core_json
wait $first
