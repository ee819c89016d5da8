#: hidden    hidden-effect campaigns by the command line; table into docs/results.md (with options: only printed)
#:           hidden real|foreign|later|noise: further kinds; hidden pairs: table into docs/effects.md
cmd_hidden() {
  cmd_build
  local keep=()
  [ $# != 0 ] || keep=("$PY" tools/into_results.py "hidden effects")
  [ "$*" != pairs ] || keep=("$PY" tools/into_results.py pairs)
  OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests/hidden_effects "${keep[@]}" $PY tests/hidden_effects/campaign.py --jobs "$JOBS" "$@"
}
