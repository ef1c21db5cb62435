#!/usr/bin/env bash
# Trains at one airport and judges at another: 18 approaches at the first, 6 at the second (tests/data/airport.toml at full size), with the
# same rig relative to the runway.
# Usage: scripts/cross-airport.sh OUT [ICAO/RUNWAY ICAO/RUNWAY]; without runways LSZH/14 and FIMP/32. Run it again to resume.
set -euo pipefail
cd "$(dirname "$0")/.."

[ $# -gt 0 ] || { sed -n '2,4s/^# //p' "$0" >&2; exit 2; }
out=$1
here=${2:-LSZH/14}
there=${3:-FIMP/32}
dtd=${DTD:-${CARGO_TARGET_DIR:-target}/release/dtd}
[ -x "$dtd" ] || cargo build --release --locked
mkdir -p "$out"

# RUNWAY REPEATS
corpus() {
    airport=${1%/*}
    sed -e "s/^airport = .*/airport = \"$airport\"/" -e "s/^runway = .*/runway = \"${1#*/}\"/" \
        -e 's/^times = .*/times = ["sunset-00:40", "09:00", "12:00"]/' -e "s/^repeats = .*/repeats = $2/" \
        -e 's/^width_px = .*/width_px = 1920/' -e 's/^height_px = .*/height_px = 1280/' \
        tests/data/airport.toml >"$out/$airport.toml"
    "$dtd" generate "$out/$airport.toml" --sim mock --out "$out/$airport"
    "$dtd" label "$out/$airport"
    "$dtd" detect "$out/$airport" --model models/aircraft.onnx
}
corpus "$here" 6
corpus "$there" 2
[ -e "$out/run" ] || "$dtd" train "$out/${here%/*}" --out "$out/run" --quick
"$dtd" evaluate "$out/run" --corpus "$out/${there%/*}" --side all --out "$out/judged"
