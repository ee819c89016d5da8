# libFuzzer on all parsers, starting from the committed corpora: expressions and the JSON of robots and terms in the C++
# core (30 s each); the node with sequences of frames, and with sequences of steps whose motion is checked (20 s each);
# the table reader, with the joint path for every table that it accepts (20 s).
build_preset sanitize fitter_fuzz canopen_fuzz motion_fuzz table_fuzz

# fuzz_one HARNESS CORPUS SECONDS OPTIONS...: new inputs and the log are kept in out/fuzz; the log is printed on a
# failure.
fuzz_one() {
  local name found log
  name=$(basename "$1")
  found=out/fuzz/$name log=out/fuzz/$name.log
  mkdir -p "$found"
  "$1" "$found" "$2" -max_total_time="${ARMTRUE_FUZZ_SECONDS:-$3}" -artifact_prefix="$found/" -print_final_stats=1 "${@:4}" \
    >"$log" 2>&1 || { tail -40 "$log"; return 1; }
  echo "$name: $(grep -E "number_of_executed_units|new_units_added" "$log" | tr -s '\n ' ' ')"
}
(
  fuzz_one build/sanitize/fitter/expression_fuzz tests/fuzz/corpus/expression 30 -max_len=4096 -timeout=10 -rss_limit_mb=2048 -seed=1 \
    -dict=tests/fuzz/tokens.dict
  fuzz_one build/sanitize/firmware/testing/canopen_fuzz firmware/testing/fuzz/corpus 20 -max_len=2048
  fuzz_one build/sanitize/firmware/testing/motion_fuzz firmware/testing/fuzz/motion_corpus 20 -max_len=40 -len_control=0
) &
first=$!
fuzz_one build/sanitize/fitter/json_fuzz tests/fuzz/corpus/core_json 30 -max_len=4096 -timeout=10 -rss_limit_mb=2048 -seed=1 \
  -dict=tests/fuzz/tokens.dict
fuzz_one build/sanitize/firmware/core/table_fuzz firmware/core/table/fuzz/corpus 20 -max_len=16385
wait $first
