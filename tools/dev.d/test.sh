#: test      everything from nothing to the test verdict (what CI runs); [STEP] runs the steps whose name has it
# Each part adds a step in tools/test.d/NN-name.sh, run in order; a failing step fails the run but later steps still run.
# Of all that this shell waited for so far.
processor_seconds() { awk '{ print int(($16 + $17) / 100) }' /proc/$$/stat; }

cmd_test() {
  cmd_build
  build_preset release firmware_tests
  local failed=() took=() step status begin busy
  for step in tools/test.d/*"${1:-}"*.sh; do
    [ -e "$step" ] || { echo "test: no step of tools/test.d has '$1' in its name" >&2; return 2; }
    say "test: $(basename "$step" .sh)"
    status=0 begin=$SECONDS busy=$(processor_seconds)
    ( set -euo pipefail; . "$step" ) || status=$?
    took+=("$(basename "$step" .sh) $((SECONDS - begin)) s, $(($(processor_seconds) - busy)) s of processor")
    [ $status = 0 ] || failed+=("$(basename "$step" .sh)")
  done
  say "steps took:"
  printf '  %s\n' "${took[@]}"
  if [ ${#failed[@]} -gt 0 ]; then say "FAILED: ${failed[*]}"; return 1; fi
  say "all steps passed"
}
