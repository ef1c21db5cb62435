#!/usr/bin/env bash
# Regenerates the tape that the tests replay: records `dtd generate` of tests/data/tape/session.toml against the stand-in, and writes the
# hashes of the tables from its replay. Needed when a request of the capture link changes, or a table.
set -euo pipefail
cd "$(dirname "$0")/.."

cargo build --release --locked --workspace
dtd=target/release/dtd
folder=tests/data/tape
work=$(mktemp -d)
recorder=
trap 'kill $recorder 2>/dev/null || true; rm -rf "$work"' EXIT

# The address in the JSON line that a process prints when it is ready.
address() {
    for _ in $(seq 300); do
        grep -q '"udp"' "$1" && break
        sleep 0.1
    done
    sed 's/.*"udp":"\([^"]*\)".*/\1/' "$1"
}

"$dtd" tape --sim mock --port 0 --out "$work/session.mcap" >"$work/recorder" &
recorder=$!
recorder_address=$(address "$work/recorder")
"$dtd" generate "$folder/session.toml" --out "$work/corpus" --sim "$recorder_address"
kill -TERM "$recorder"
wait "$recorder"
recorder=
mv "$work/session.mcap" "$folder/session.mcap"
DTD_WRITE_EXPECTED=1 cargo test --release --locked --workspace --test tape -- the_stored_tape
ls -l "$folder"
