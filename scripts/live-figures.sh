#!/usr/bin/env bash
# Figures of `dtd estimate` (docs/live.md), each by its judge in tests/judges/: OUT/PART.json. Parts: figures (2 minutes, on an idle machine),
# others (2), cameras (5, on an idle machine, as root), empty (30 minutes of scene), failures (20 of each kind, 30 images per second; 12),
# arrivals (an hour, with error.json), offsets (half an hour). Feeds are recorded with the bundled simulator. The run is of `dtd demo`: RUN, or OUT/demo/run, which is made.
# Usage: scripts/live-figures.sh OUT [PART ..]; without parts: figures others. DTD is the program, if it is not target/release/dtd.
set -euo pipefail
cd "$(dirname "$0")/.."

[ $# -gt 0 ] || { sed -n '2,6s/^# //p' "$0" >&2; exit 2; }
out=$1
shift
dtd=${DTD:-${CARGO_TARGET_DIR:-target}/release/dtd}
[ -x "$dtd" ] || cargo build --release --locked
mkdir -p "$out"
[ $# -gt 0 ] || set -- figures others
run=${RUN:-$out/demo/run}
[ -d "$run" ] || "$dtd" demo --out "$out/demo"
python=.venv/bin/python

feeds() {
    "$dtd" generate "docs/results/live-$1.toml" --sim mock --out "$out/live-$1"
    "$dtd" label "$out/live-$1"
}

for part; do
    case $part in
    figures | others | cameras) feeds figures ;;
    failures | empty | arrivals | offsets) feeds arrivals ;;
    *) echo "unknown part $part; expected figures, others, cameras, failures, empty, arrivals or offsets" >&2; exit 2 ;;
    esac
    judge() {
        "$python" "tests/judges/live_$1.py" "$dtd" "$run" "${@:2}" >"$out/$part.json"
    }
    corpus=$out/live-arrivals
    case $part in
    figures)
        views=$(echo "$out"/live-figures/scenarios/*/views)
        judge figures 60 "left=$views/left.mp4" "right=$views/right.mp4"
        ;;
    others) judge others "$out/live-figures" "$out/others" ;;
    cameras) judge cameras "$out/live-figures" "$out/cameras" ;;
    failures) judge failures "$corpus" "$out/failures" 20 30 ;;
    empty) judge hours "$corpus" "$out/empty" empty 30 ;;
    arrivals)
        judge hours "$corpus" "$out/arrivals" arrivals 12
        "$python" tests/judges/live_mape.py "$corpus" "$out/arrivals" >"$out/error.json"
        ;;
    offsets) judge offsets "$corpus" "$out/offsets" 0900-clear-r1 0900-cloudy-r1 1500-clear-r1 0900-clear-r1 ;;
    esac
    cat "$out/$part.json"
done
