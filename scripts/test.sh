#!/usr/bin/env bash
# Everything that must hold before a change lands, cheapest step first. CI runs this and nothing else. Some tests only:
# `cargo test --release --workspace --test NAME`, after scripts/setup.sh.
# Tests run in the release profile: they render, encode, decode and train, and they share the build with the demo.
set -euo pipefail
cd "$(dirname "$0")/.."

bash scripts/setup.sh
python3 scripts/check_prose.py
cargo fmt --all --check
(cd xplane-bridge/plugin && ../../.venv/bin/python -m mypy --strict --cache-dir=/dev/null PI_dtd_bridge.py dtd_bridge)
(cd python && ../.venv/bin/python -m mypy --strict --cache-dir=/dev/null dtd)
# Minutes the first time, when it builds its tool.
bash scripts/supply-chain.sh
cargo clippy --release --locked --workspace --all-targets -- -D warnings
.venv/bin/python scripts/run_tests.py
