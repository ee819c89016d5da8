# The simulator is a package of its own so that tests, tools and notebooks import it without a path trick.
ensure_sim() {
  $PY -c 'import armtrue_sim' 2>/dev/null ||
    $PY -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e sim
}
