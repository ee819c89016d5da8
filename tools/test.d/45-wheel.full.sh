# Tests the wheel in an empty environment without Debian's packages on the path, and builds the sdist.
cmd_wheel
OPENBLAS_NUM_THREADS=1 $PY -m pytest -q -p no:cacheprovider tests/wheel
rm -rf build/from-sdist
$PY -m pip wheel --quiet --disable-pip-version-check --no-deps --no-build-isolation --wheel-dir build/from-sdist dist/armtrue-*.tar.gz
ls build/from-sdist/armtrue-*.whl
