#!/usr/bin/env bash
# The whole pipeline with one command: installs what building needs, builds, and runs `dtd demo`.
# Results: target/demo/corpus and target/demo/run/{metrics.json,report.html}. Arguments go to `dtd demo`.
set -euo pipefail
cd "$(dirname "$0")/.."

bash scripts/setup-build.sh
cargo build --release --locked
exec "${CARGO_TARGET_DIR:-target}/release/dtd" demo "$@"
