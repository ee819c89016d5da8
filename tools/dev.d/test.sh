#: test      the tests of every change (CI runs these; 12 minutes from a bare machine)
#:           [full]: all tests; [STEP]: steps with STEP in their name
# Each step is a file tools/test.d/NN-name.sh, or NN-name.full.sh if only `./dev test full` runs it. They run in order;
# if one fails the run fails, but later steps still run. Python tests marked `full` also run only in the full run.

# Processor seconds of all child processes that this shell has waited for.
processor_seconds() { awk '{ print int(($16 + $17) / 100) }' /proc/$$/stat; }

# run_step FILE: runs a step, which ends at the first command that fails; STEP_STATUS is its status. Do not call it with
# `||`, `&&` or `if`: bash then ignores `set -e` in the step.
run_step() {
  set +e
  ( set -euo pipefail; . "$1" )
  STEP_STATUS=$?
  set -e
}

# run_pytest ARGUMENT...: the options of pytest that all steps share; a step selects the tests of its level by -m.
run_pytest() { $PY -m pytest -q -rs --durations=20 --durations-min=4 -p no:cacheprovider "$@"; }

# install_for_tests [full]: takes two minutes, most of it on one core.
install_for_tests() {
  install_packages bus firmware test "$@"
  ensure_venv run test lint
}

cmd_test() {
  local failed=() took=() step begin busy name more=
  LEVEL=quick LEVEL_MARK="not full"
  if [ "${1:-}" = full ]; then LEVEL=full LEVEL_MARK=""; shift; fi
  # A step named on the command line runs at any level; a .full step needs the packages of the full run.
  if [ $LEVEL = full ] || { [ -n "${1:-}" ] && compgen -G "tools/test.d/*$1*.full.sh" >/dev/null; }; then more=full; fi
  install_packages run unit
  ensure_venv build
  beside install_for_tests $more
  configure release -DBUILD_TESTING=ON
  say "building"
  build_preset release product firmware_tests
  together
  for step in tools/test.d/*"${1:-}"*.sh; do
    [ -e "$step" ] || { echo "test: no step of tools/test.d has '$1' in its name" >&2; return 2; }
    [[ $LEVEL = full || -n ${1:-} || $step != *.full.sh ]] || continue
    name=$(basename "$step" .sh) name=${name%.full}
    say "test: $name"
    begin=$SECONDS busy=$(processor_seconds)
    run_step "$step"
    took+=("$name $((SECONDS - begin)) s, $(($(processor_seconds) - busy)) s of processor")
    [ $STEP_STATUS = 0 ] || failed+=("$name")
  done
  say "steps took ($LEVEL, $SECONDS s in all, installing and building included):"
  printf '  %s\n' "${took[@]}"
  if [ ${#failed[@]} -gt 0 ]; then say "FAILED: ${failed[*]}"; return 1; fi
  say "all steps passed"
}
