#: r5f-interrupts  CAN tests of the Cortex-R5F image with real interrupts, on a newer QEMU than Debian 12's
#:           (fetched, not installed)
# See firmware/ports/r5f/README.md. ARMTRUE_DEBIAN_MIRROR selects another archive, such as a dated one of
# snapshot.debian.org.
R5F_QEMU=build/qemu-with-interrupts
R5F_QEMU_SUITE=trixie-backports
R5F_QEMU_LEAST=10.2  # the first version that connects an interrupt controller to the core

# r5f_private_apt FOLDER: sets up a private apt below FOLDER. It considers no package as installed, so that it resolves
# all dependencies down to the C library. It uses only the system's network settings and Debian's keys.
r5f_private_apt() {
  local folder=$1 mirror=${ARMTRUE_DEBIAN_MIRROR:-http://deb.debian.org/debian} suite is_current=true
  [ -z "${ARMTRUE_DEBIAN_MIRROR:-}" ] || is_current=false
  mkdir -p "$folder"/{etc/preferences.d,state/lists/partial,cache/archives/partial}
  : >"$folder/status"
  for suite in "${R5F_QEMU_SUITE%-backports}" "$R5F_QEMU_SUITE"; do
    echo "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] $mirror $suite main"
  done >"$folder/etc/sources.list"
  apt-config dump | grep -E '^Acquire::https?::' >"$folder/apt.conf" || true
  cat >>"$folder/apt.conf" <<A
Dir::Etc "$folder/etc";
Dir::Etc::parts "/dev/null";
Dir::Etc::sourceparts "/dev/null";
Dir::State "$folder/state";
Dir::State::status "$folder/status";
Dir::Cache "$folder/cache";
Acquire::Languages "none";
Acquire::Check-Valid-Until "$is_current";
APT::Default-Release "$R5F_QEMU_SUITE";
APT::Install-Recommends "false";
APT::Sandbox::User "root";
A
}

# Fetches the emulator with all libraries that it links and unpacks them; the scripts in bin/ start it by its own
# loader.
r5f_fetch_qemu() {
  local folder=$ROOT/$R5F_QEMU.part candidate package
  rm -rf "$folder"
  r5f_private_apt "$folder"
  (
    export APT_CONFIG=$folder/apt.conf
    apt-get update -qq --error-on=any
    candidate=$(apt-cache policy qemu-system-arm | awk '$1 == "Candidate:" { print $2 }')
    say "fetching qemu-system-arm $candidate and its libraries from $R5F_QEMU_SUITE into $R5F_QEMU"
    dpkg --compare-versions "${candidate:-none}" ge "1:$R5F_QEMU_LEAST" ||
      { echo "r5f-interrupts: QEMU $R5F_QEMU_LEAST or later is needed" >&2; exit 1; }
    apt-get install -qq -y --download-only qemu-system-arm >/dev/null
  )
  for package in "$folder"/cache/archives/*.deb; do dpkg-deb -x "$package" "$folder/root"; done
  (cd "$folder/cache/archives" && sha256sum -- *.deb) >"$folder/packages.sha256"
  mkdir "$folder/bin"
  cat >"$folder/bin/qemu-system-aarch64" <<'W'
#!/bin/sh
root=$(dirname "$0")/../root
loader=$(echo "$root"/usr/lib/*/ld-linux*.so.*)
exec "$loader" --library-path "$(dirname "$loader")" "$root/usr/bin/${0##*/}" -L "$root/usr/share/qemu" "$@"
W
  chmod +x "$folder/bin/qemu-system-aarch64"
  rm -rf "$folder"/{cache,state}
  rm -rf "${ROOT:?}/$R5F_QEMU"
  mv "$folder" "$R5F_QEMU"
}

cmd_r5f_interrupts() {
  local record=$ROOT/out/r5f-interrupts.txt version
  install_packages run firmware
  cmd_build
  ensure_venv run test
  build_preset r5f | tail -1
  if [ ! -d $R5F_QEMU ]; then r5f_fetch_qemu; fi
  version=$($R5F_QEMU/bin/qemu-system-aarch64 --version | head -1)
  say "the suites on $version ($R5F_QEMU; remove it to fetch the latest)"
  mkdir -p out
  rm -f "$record"
  PATH=$ROOT/$R5F_QEMU/bin:$PATH ARMTRUE_R5F_INTERRUPTS=$record \
    $PY -m pytest -q -p no:cacheprovider tests/can/test_on_r5f.py tests/firmware_boot/test_r5f_boot.py tests/firmware_boot/r5f
  [ -s "$record" ] || { echo "r5f-interrupts: no test counted interrupts" >&2; return 1; }
  say "passed, by interrupt:"
  cat "$record"
}
