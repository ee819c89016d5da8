#: test      the tests of every change (what CI runs; 12 minutes from a bare machine); [full] all there are; [STEP] steps by name
# Each step is a file tools/test.d/NN-name.sh, or NN-name.full.sh where `./dev test full` alone runs it. They run in order;
# a failing step fails the run, but later steps still run. Python tests marked `full` belong to the full run too.

# Of all that this shell waited for so far.
processor_seconds() { awk '{ print int(($16 + $17) / 100) }' /proc/$$/stat; }

# run_step FILE: leaves its status in STEP_STATUS; the first command that fails ends it. (Never call it behind `||`, `&&` or
# `if`: bash then ignores `set -e` in all that runs.)
run_step() {
  set +e
  ( set -euo pipefail; . "$1" )
  STEP_STATUS=$?
  set -e
}

# pytest with the tests of this level, without a word about those that are left out.
run_pytest() { $PY -m pytest -q -rs --durations=20 --durations-min=4 -p no:cacheprovider "$@"; }

# install_for_tests [full]: takes two minutes, mostly on one core.
install_for_tests() {
  install_packages bus firmware test "$@"
  ensure_venv run test lint
}

cmd_test() {
  local failed=() took=() step begin busy name more=
  LEVEL=quick LEVEL_MARK="not full"
  if [ "${1:-}" = full ]; then LEVEL=full LEVEL_MARK=""; shift; fi
  # A step that is named runs at any level, and needs what its level needs.
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
