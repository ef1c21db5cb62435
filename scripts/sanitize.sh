#!/usr/bin/env bash
# AddressSanitizer on the tests of the code with `unsafe`: crates/dataset/src/video/conversion/scaler.rs (functions of FFmpeg that its crate
# does not wrap). Builds in a separate folder, target/sanitize.
#
# The sanitizer is an unstable option of the compiler; RUSTC_BOOTSTRAP enables it in the stable one. FFmpeg itself is not instrumented, but its
# allocations go through the sanitizer, and Rust's accesses to them are checked.
set -euo pipefail
cd "$(dirname "$0")/.."

target=$(rustc -vV | sed -n 's/^host: //p')
export RUSTC_BOOTSTRAP=1 RUSTFLAGS=-Zsanitizer=address CARGO_TARGET_DIR=target/sanitize CARGO_INCREMENTAL=0 CARGO_PROFILE_DEV_DEBUG=line-tables-only
# Memory that FFmpeg keeps until the process ends is not our leak.
export ASAN_OPTIONS=detect_leaks=0
exec cargo test --locked --target "$target" -p dataset --lib
