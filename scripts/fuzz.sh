#!/usr/bin/env bash
# Fuzzes what reads datagrams: scripts/fuzz.sh [SECONDS], 600 by default, on one core. Ends with the number of executions, or with
# the input that broke it. Begins from the golden packets; what it learned stays in fuzz/corpus.
#
# Installs cargo-fuzz if it is not there. Needs a C++ compiler (libFuzzer), no nightly toolchain: address sanitizing, which
# would need one, finds nothing in code that forbids unsafe.
set -euo pipefail
cd "$(dirname "$0")/.."

command -v cargo-fuzz >/dev/null || cargo install --locked cargo-fuzz@0.13.2
mkdir -p fuzz/corpus/packets
cp xplane-bridge/golden/*.bin fuzz/corpus/packets/
exec cargo fuzz run --sanitizer none packets -- -max_total_time="${1:-600}" -max_len=2048 -print_final_stats=1
