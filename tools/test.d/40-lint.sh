# Layout, lint and types; `./dev format` mends the layout.
lint_failed=0
$PY -m ruff check || lint_failed=1
$PY -m ruff format --check || lint_failed=1
$PY -m mypy --strict host_tools/armtrue || lint_failed=1
cpp_sources | xargs clang-format-14 --dry-run -Werror || lint_failed=1
[ $lint_failed = 0 ]
