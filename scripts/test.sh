#!/usr/bin/env bash
# Everything that must hold before a change lands, cheapest step first. CI runs this and nothing else. Some tests only:
# `cargo test --release --workspace --test NAME`, after scripts/setup.sh.
# Tests run in the release profile: they render, encode, decode and train, and they share the build with the demo.
set -euo pipefail
cd "$(dirname "$0")/.."

# Its tool takes minutes to build the first time: while packages are downloaded, if there is a compiler already.
if command -v cc >/dev/null; then
    bash scripts/supply-chain.sh &
    supply_chain=$!
fi
bash scripts/setup.sh
python3 scripts/check_prose.py
python3 scripts/check_modules.py
cargo fmt --all --check
(cd xplane-bridge/plugin && ../../.venv/bin/python -m mypy --strict --cache-dir=/dev/null PI_dtd_bridge.py dtd_bridge)
(cd python && ../.venv/bin/python -m mypy --strict --cache-dir=/dev/null dtd)
if [ -n "${supply_chain:-}" ]; then wait "$supply_chain"; else bash scripts/supply-chain.sh; fi
cargo clippy --release --locked --workspace --all-targets -- -D warnings
.venv/bin/python scripts/run_tests.py
