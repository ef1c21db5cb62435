#!/usr/bin/env bash
# Kills `dtd generate` at random moments with `kill -9`, repeatedly, and compares the resulting corpus with an undisturbed one:
# every file of every scenario must have the same bytes. Usage: scripts/kill-test.sh [KILLS] [SWEEP.toml] [extra arguments of generate..]
#
# Only runs that were killed while they worked count. When a corpus is complete before the kills are used up, the next one is started.
set -euo pipefail
cd "$(dirname "$0")/.."

kills=${1:-50}
sweep=${2:-tests/data/small.toml}
shift $(($# < 2 ? $# : 2))
dtd=${DTD:-target/release/dtd}
[ -x "$dtd" ] || cargo build --release --locked
RANDOM=${SEED:-1}

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
began=$(date +%s%N)
"$dtd" generate "$sweep" --out "$work/whole" "$@" 2>/dev/null >/dev/null
took_ms=$((($(date +%s%N) - began) / 1000000))
hashes() { (cd "$1" && find . -type f -exec sha256sum {} + | sort -k 2); }
hashes "$work/whole" >"$work/expected"

killed=0 corpora=0 partial=0
compare() {
    "$dtd" generate "$sweep" --out "$work/corpus" "$@" 2>/dev/null >/dev/null
    hashes "$work/corpus" >"$work/found"
    diff "$work/expected" "$work/found" || { echo "kill-test: the corpus differs after $killed kills" >&2; exit 1; }
    corpora=$((corpora + 1))
    rm -rf "$work/corpus"
}
in_this_corpus=0
while ((killed < kills)); do
    "$dtd" generate "$sweep" --out "$work/corpus" "$@" >/dev/null 2>&1 &
    run=$!
    # Anywhere within the duration of a whole run.
    ms=$((RANDOM % (took_ms + 1)))
    sleep "$((ms / 1000)).$(printf %03d $((ms % 1000)))"
    kill -9 "$run" 2>/dev/null || true
    code=0
    wait "$run" 2>/dev/null || code=$?
    if ((code == 137)); then
        killed=$((killed + 1))
        in_this_corpus=$((in_this_corpus + 1))
        if compgen -G "$work/corpus/scenarios/*.partial" >/dev/null; then partial=$((partial + 1)); fi
    elif ((code == 0)); then
        # Complete before it was killed.
        compare "$@"
        in_this_corpus=0
    fi
    # Late kills find little left to do: start a new corpus from time to time.
    if ((in_this_corpus >= 5)); then
        compare "$@"
        in_this_corpus=0
    fi
done
if [ -d "$work/corpus" ]; then compare "$@"; fi
files=$(wc -l <"$work/expected")
echo "kill-test: $killed kills ($partial in the middle of a scenario), $corpora corpora, each of $files files byte-identical to the undisturbed one"
