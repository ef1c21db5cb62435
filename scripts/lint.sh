#!/usr/bin/env bash
# Runs clippy on all crates. Where nothing has been built yet, builds all tests meanwhile.
set -euo pipefail
cd "$(dirname "$0")/.."

workspace=(--release --locked --workspace)
target=$(cargo metadata --no-deps --format-version 1 --locked | python3 -c 'import json, sys; print(json.load(sys.stdin)["target_directory"])')
# What is fresh is not compiled, and not linted on the way.
if [ -n "${RUSTC_WRAPPER:-}${CARGO_BUILD_RUSTC_WRAPPER:-}" ] || compgen -G "$target/release/.fingerprint/*" >/dev/null; then
    cargo clippy "${workspace[@]}" --all-targets -- -D warnings
else
    export RUSTC_WRAPPER=$PWD/scripts/lint_and_build.sh
    cargo test "${workspace[@]}" --no-run
    cargo build "${workspace[@]}" --bench '*'
fi
