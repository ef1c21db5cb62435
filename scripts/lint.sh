#!/usr/bin/env bash
# Runs clippy on all crates. Where nothing has been built yet, builds all tests meanwhile.
set -euo pipefail
cd "$(dirname "$0")/.."

workspace=(--release --locked --workspace)
built=${CARGO_TARGET_DIR:-target}/release/.fingerprint
if [ -n "${RUSTC_WRAPPER:-}" ] || compgen -G "$built/dataset-*" >/dev/null; then
    cargo clippy "${workspace[@]}" --all-targets -- -D warnings
else
    export RUSTC_WRAPPER=$PWD/scripts/lint_and_build.sh
    cargo test "${workspace[@]}" --no-run
    cargo build "${workspace[@]}" --bench '*'
fi
