#!/usr/bin/env bash
# Faults that need root: a full disk (a small tmpfs), a file system that becomes read-only, a stand-in that is stopped (SIGSTOP) in the
# middle of its work. Each time the run must end with a message or continue, nothing incomplete may be accepted, and the next run must end
# with the bytes of an undisturbed one. Run as root.
set -euo pipefail
cd "$(dirname "$0")/.."

sweep=${1:-tests/data/small.toml}
dtd=${DTD:-target/release/dtd}
[ -x "$dtd" ] || cargo build --release --locked
[ "$(id -u)" -eq 0 ] || { echo "full-disk-test: mounting needs root" >&2; exit 1; }

work=$(mktemp -d)
cleanup() {
    umount "$work/disk" 2>/dev/null || true
    rm -rf "$work"
}
trap cleanup EXIT
mkdir "$work/disk"
hashes() { (cd "$1" && find . -type f -exec sha256sum {} + | sort -k 2); }
fail() { echo "full-disk-test: $*" >&2; exit 1; }

"$dtd" generate "$sweep" --out "$work/whole" >/dev/null 2>&1
hashes "$work/whole" >"$work/expected"
size_kb=$(du -sk --apparent-size "$work/whole" | cut -f 1)

# A disk with space for about half of it.
mount -t tmpfs -o "size=$((size_kb / 2))k" tmpfs "$work/disk"
code=0
"$dtd" generate "$sweep" --out "$work/disk/corpus" --json >"$work/outcome" 2>"$work/said" || code=$?
[ "$code" -eq 3 ] || fail "a full disk ended with $code, expected 3: $(cat "$work/said")"
grep -q '"cause": "storage"' "$work/outcome" || fail "not stopped for storage: $(cat "$work/outcome")"
grep -q ' free, and about ' "$work/said" || fail "no figures: $(cat "$work/said")"
made=$(find "$work/disk/corpus/scenarios" -mindepth 1 -maxdepth 1 ! -name '*.partial' | wc -l)
for scenario in "$work"/disk/corpus/scenarios/*; do
    [ -e "$scenario" ] || continue
    case $scenario in *.partial) continue ;; esac
    diff -r "$scenario" "$work/whole/scenarios/$(basename "$scenario")" || fail "$scenario is not whole"
done
echo "full disk: ended with 1 after $made whole scenarios: $(grep '^error' "$work/said" | head -c 300)"

# Read-only: rejected at once, with the path.
mount -o remount,ro "$work/disk"
code=0
"$dtd" generate "$sweep" --out "$work/disk/corpus" >/dev/null 2>"$work/said" || code=$?
[ "$code" -eq 2 ] || fail "a read-only disk ended with $code, expected 2: $(cat "$work/said")"
echo "read-only: $(grep '^error' "$work/said")"

# Space again: resumes.
mount -o "remount,rw,size=$((size_kb * 3 + 2048))k" "$work/disk"
"$dtd" generate "$sweep" --out "$work/disk/corpus" >/dev/null 2>&1
hashes "$work/disk/corpus" | diff "$work/expected" - || fail "the corpus differs after a full disk"
echo "room again: the corpus is byte-identical"

# The stand-in is stopped permanently in the middle of a scenario: detected after a minute, restarted.
"$dtd" generate "$sweep" --out "$work/frozen" >/dev/null 2>"$work/said" &
run=$!
until compgen -G "$work/frozen/scenarios/*.partial" >/dev/null; do sleep 0.02; done
kill -STOP "$(pgrep -P "$run")"
wait "$run" || fail "a frozen stand-in ended the run: $(cat "$work/said")"
hashes "$work/frozen" | diff "$work/expected" - || fail "the corpus differs after a frozen stand-in"
echo "frozen stand-in: $(grep 'tried again' "$work/said"); the corpus is byte-identical"
