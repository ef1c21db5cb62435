#!/usr/bin/env bash
# Records two small approaches (tests/data/airport.toml) at each of eight built-in airports: both hemispheres, both sides of Greenwich, 7 to
# 2,545 m. All are planned, recorded with the bundled simulator, labelled and verified.
# Usage: scripts/airports.sh OUT [ICAO/RUNWAY ..]; without runways the eight. Run it again to resume.
set -euo pipefail
cd "$(dirname "$0")/.."

[ $# -gt 0 ] || { sed -n '2,4s/^# //p' "$0" >&2; exit 2; }
out=$1
shift
dtd=${DTD:-${CARGO_TARGET_DIR:-target}/release/dtd}
[ -x "$dtd" ] || cargo build --release --locked
mkdir -p "$out"
[ $# -gt 0 ] || set -- BIKF/19 FIMP/32 HAAB/25R KLAX/25L LSZH/14 SBGR/28L SKBO/14R WSSS/02L
for place; do
    airport=${place%/*}
    name=$airport-${place#*/}
    sed -e "s/^airport = .*/airport = \"$airport\"/" -e "s/^runway = .*/runway = \"${place#*/}\"/" tests/data/airport.toml >"$out/$name.toml"
    "$dtd" plan "$out/$name.toml"
    "$dtd" generate "$out/$name.toml" --sim mock --out "$out/$name"
    "$dtd" label "$out/$name"
    "$dtd" verify "$out/$name"
done
