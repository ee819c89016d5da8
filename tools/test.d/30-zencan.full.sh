# Builds a third-party CANopen client in Rust (zencan-client of crates.io), with which tests/can tests the node.
rust_minor=$(cargo --version 2>/dev/null | sed -nE 's/^cargo 1\.([0-9]+).*/\1/p' || true)
[ "${rust_minor:-0}" -ge 85 ] || install_packages rust
CARGO_TARGET_DIR=$ROOT/build/zencan cargo build --quiet --locked --manifest-path tests/can/zencan/Cargo.toml
