#: bench     speed and full-size campaigns, printed as tables ([PART] runs the parts of tools/bench.d whose name has it)
# Each part adds a file tools/bench.d/NN-name.sh, run in order; a failing part fails the run but later parts still run.
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
