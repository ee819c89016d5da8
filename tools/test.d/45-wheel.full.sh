# The wheel, in an empty environment with nothing of Debian's on the path; and that the sdist builds.
cmd_wheel
OPENBLAS_NUM_THREADS=1 $PY -m pytest -q -p no:cacheprovider tests/wheel
rm -rf build/from-sdist
$PY -m pip wheel --quiet --disable-pip-version-check --no-deps --no-build-isolation --wheel-dir build/from-sdist dist/armtrue-*.tar.gz
ls build/from-sdist/armtrue-*.whl
