#: bench     speed and full-size campaigns, printed as tables ([PART]: parts of tools/bench.d with PART in their name)
# Each part is a file tools/bench.d/NN-name.sh. They run in order; if one fails the run fails, but later parts still
# run.
cmd_bench() {
  install_packages run unit bus firmware test bench
  cmd_build
  ensure_venv test
  configure release -DBUILD_TESTING=ON
  local failed=() part
  for part in tools/bench.d/*"${1:-}"*.sh; do
    [ -e "$part" ] || { echo "bench: no part of tools/bench.d has '$1' in its name" >&2; return 2; }
    say "bench: $(basename "$part" .sh)"
    run_step "$part"
    [ $STEP_STATUS = 0 ] || failed+=("$(basename "$part" .sh)")
  done
  [ ${#failed[@]} -eq 0 ] || { say "FAILED: ${failed[*]}"; return 1; }
}
