#: wheel     build the sdist and dist/armtrue-VERSION-….whl, which needs neither a compiler nor Debian packages
#:           (5 minutes, once)
CERES_SOURCE=ceres-solver=2.1.0+really2.1.0+dfsg-1
CERES_ARCHIVE=.cache/sdist/ceres-solver_2.1.0+really2.1.0+dfsg.orig.tar.xz

# Fetches Debian's source package of Ceres. apt uses sources and lists below .cache; those of the system are not
# changed.
fetch_ceres() {
  [ ! -e "$CERES_ARCHIVE" ] || return 0
  local work=$ROOT/.cache/apt
  say "fetching Debian's source of Ceres"
  mkdir -p "$work"/{lists/partial,archives/partial,source} .cache/sdist
  echo "deb-src [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] ${ARMTRUE_DEBIAN_MIRROR:-http://deb.debian.org/debian} bookworm main" \
    >"$work/sources.list"
  local apt=(apt-get -qq -o "Dir::Etc::sourcelist=$work/sources.list" -o Dir::Etc::sourceparts=/dev/null -o "Dir::State::lists=$work/lists"
    -o "Dir::Cache=$work" -o APT::Sandbox::User=root)
  "${apt[@]}" update
  (cd "$work/source" && "${apt[@]}" source --download-only "$CERES_SOURCE" >/dev/null)
  mv "$work/source/$(basename "$CERES_ARCHIVE")" "$CERES_ARCHIVE"
  rm -rf "$work"
}

cmd_wheel() {
  install_packages run
  ensure_venv build run wheel
  fetch_ceres
  [ -f build/release/build.ninja ] || configure release -DBUILD_TESTING=OFF  # fetches Monocypher's source
  say "building the wheel and the sdist"
  rm -rf dist
  mkdir -p dist out
  $PY -m build --no-isolation --sdist --wheel --outdir dist/raw . >out/wheel.log 2>&1 || { tail -40 out/wheel.log; return 1; }
  PATH=$ROOT/.venv/bin:$PATH $PY -m auditwheel repair --wheel-dir dist dist/raw/*.whl >>out/wheel.log 2>&1 || { tail -40 out/wheel.log; return 1; }
  mv dist/raw/*.tar.gz dist/
  rm -r dist/raw
  ls -l dist
}
