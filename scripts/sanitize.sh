#!/usr/bin/env bash
# AddressSanitizer over the tests of the code that has `unsafe`: dataset/src/video/scaler.rs (functions of FFmpeg that its crate does not wrap) and
# xplane-bridge/src/link/shared_memory.rs (mapped memory). Builds in a folder of its own, target/sanitize.
#
# The sanitizer is an unstable option of the compiler; RUSTC_BOOTSTRAP lets the stable one take it. FFmpeg itself is not instrumented, but its
# allocations are the sanitizer's, and what Rust reads and writes in them is checked.
set -euo pipefail
cd "$(dirname "$0")/.."

target=$(rustc -vV | sed -n 's/^host: //p')
export RUSTC_BOOTSTRAP=1 RUSTFLAGS=-Zsanitizer=address CARGO_TARGET_DIR=target/sanitize CARGO_INCREMENTAL=0 CARGO_PROFILE_DEV_DEBUG=line-tables-only
# What FFmpeg keeps until the process ends is no leak of ours.
export ASAN_OPTIONS=detect_leaks=0
exec cargo test --locked --target "$target" -p dataset -p xplane-bridge --lib
