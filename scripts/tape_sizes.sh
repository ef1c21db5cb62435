#!/usr/bin/env bash
# Tape sizes: records `dtd generate` of a sweep (tests/data/tape/session.toml by default) against the stand-in, once for each
# way to store pictures, and prints a row of docs/tape.md for each.
set -euo pipefail
cd "$(dirname "$0")/.."

sweep=${1:-tests/data/tape/session.toml}
cargo build --release --locked --workspace
dtd=target/release/dtd
work=$(mktemp -d)
recorder=
trap 'kill $recorder 2>/dev/null || true; rm -rf "$work"' EXIT

echo "| pictures | bytes on the tape | messages | bytes a picture |"
echo "|---|---|---|---|"
for frames in inline reference none; do
    # The recorder ends with its input, also if this script is killed.
    mkfifo "$work/$frames.end"
    "$dtd" tape --sim mock --port 0 --until-stdin-ends --frames "$frames" --out "$work/$frames.mcap" \
        <"$work/$frames.end" >"$work/$frames.ready" 2>"$work/$frames.said" &
    recorder=$!
    exec 3>"$work/$frames.end"
    for _ in $(seq 300); do
        grep -q '"udp"' "$work/$frames.ready" && break
        sleep 0.1
    done
    address=$(sed 's/.*"udp":"\([^"]*\)".*/\1/' "$work/$frames.ready")
    "$dtd" generate "$sweep" --out "$work/$frames" --sim "$address" >"$work/$frames.log" 2>&1
    exec 3>&-
    wait "$recorder"
    recorder=
    bytes=$(stat -c %s "$work/$frames.mcap")
    messages=$(sed -n 's/^recorded \([0-9]*\) messages.*/\1/p' "$work/$frames.said")
    # Two views a tick.
    pictures=$(sed -n 's/.*: \([0-9]*\) ticks in .*/\1/p' "$work/$frames.log" | awk '{ sum += 2 * $1 } END { print sum }')
    echo "| $frames | $bytes | $messages | $((bytes / pictures)) |"
done
