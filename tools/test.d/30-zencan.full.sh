# The CANopen client in another language (Rust, crates.io's zencan-client) that tests/can drives the node with.
rust_minor=$(cargo --version 2>/dev/null | sed -nE 's/^cargo 1\.([0-9]+).*/\1/p' || true)
[ "${rust_minor:-0}" -ge 85 ] || install_packages rust
CARGO_TARGET_DIR=$ROOT/build/zencan cargo build --quiet --locked --manifest-path tests/can/zencan/Cargo.toml
