#!/usr/bin/env bash
# Everything that must hold before a change lands. CI runs this and nothing else. Some tests only:
# `cargo test --release --workspace --test NAME`, after scripts/setup.sh.
# Tests run in the release profile: they render, encode, decode and train, and they share the build with the demo.
set -euo pipefail
cd "$(dirname "$0")/.."

python3 scripts/check_prose.py
python3 scripts/check_modules.py
python3 scripts/result_tables.py --check
bash scripts/setup-build.sh
cargo fmt --all --check

# What only the tests need is downloaded while they are built, which takes minutes of processor time.
(
    set -e
    bash scripts/setup.sh
    bash scripts/supply-chain.sh
    (cd xplane-bridge/plugin && ../../.venv/bin/python -m mypy --strict --cache-dir=/dev/null PI_dtd_bridge.py dtd_bridge)
    (cd python && ../.venv/bin/python -m mypy --strict --cache-dir=/dev/null dtd)
) &
others=$!
trap 'kill "$others" 2>/dev/null || true; wait "$others" 2>/dev/null || true' EXIT
bash scripts/lint.sh
wait "$others"
trap - EXIT
.venv/bin/python scripts/run_tests.py
