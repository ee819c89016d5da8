# Format, lint, types, and the order of packages and folders; `./dev format` corrects the format.
lint_failed=0
mkdir -p out
$PY -m ruff check || lint_failed=1
$PY -m ruff format --check || lint_failed=1
$PY -m mypy --strict host_tools/armtrue || lint_failed=1
cpp_sources | xargs .venv/bin/clang-format --dry-run -Werror || lint_failed=1
PYTHONPATH=host_tools $PY .venv/bin/lint-imports --config tools/layers.ini --no-cache >out/layers.log || { cat out/layers.log; lint_failed=1; }
$PY tools/include_order.py || lint_failed=1
# pytest identifies test files outside packages by their names alone: two files of one name cannot run together.
twice=$(git ls-files '*test_*.py' | while read -r file; do
  [ -e "$(dirname "$file")/__init__.py" ] || basename "$file"
done | sort | uniq -d)
[ -z "$twice" ] || { echo "test files of one name: $twice"; lint_failed=1; }
# A folder has at most 25 files, so that its listing is easy to read (except a fuzzer's corpus).
crowded=$(git ls-files | grep -v ^firmware/testing/fuzz/corpus/ | xargs -n 1 dirname | sort | uniq -c | awk '$1 > 25')
[ -z "$crowded" ] || { echo "folders of more than 25 files: $crowded"; lint_failed=1; }
[ $lint_failed = 0 ]
