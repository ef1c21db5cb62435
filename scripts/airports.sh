#!/usr/bin/env bash
# Records two small approaches (tests/data/airport.toml) at each of eight built-in airports: both hemispheres, both sides of Greenwich, 7 to
# 2,545 m. All are planned, recorded with the bundled simulator, labelled and verified; OUT/airports.json says what came out.
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
    "$dtd" plan "$out/$name.toml" --json >"$out/$name-plan.json"
    "$dtd" generate "$out/$name.toml" --sim mock --out "$out/$name"
    "$dtd" label "$out/$name"
    "$dtd" verify "$out/$name" --json >"$out/$name-verify.json"
done
python3 - "$out" "$@" <<'END'
import json
import pathlib
import sys

out = pathlib.Path(sys.argv[1])
found = {}
for place in sys.argv[2:]:
    name = place.replace("/", "-")
    plan, verified = (json.loads((out / f"{name}-{what}.json").read_text()) for what in ("plan", "verify"))
    threshold = plan["runway"]["threshold"]
    views = verified["views"]
    found[place] = {
        "latitude_deg": threshold["latitude_deg"],
        "longitude_deg": threshold["longitude_deg"],
        "elevation_m": threshold["altitude_msl_m"],
        "utc_offset_h": plan["utc_offset_h"],
        "sun": {row["time_of_day"]: round(row["sun_elevation_deg"], 1) for row in plan["scenarios"]},
        "images": verified["pictures"],
        "clear_boxes": sum(view["clear_boxes"] for view in views),
        "filled_boxes": sum(view["filled_boxes"] for view in views),
        "largest_offset_px": round(max(view["offset_px"] for view in views), 2),
        "faults": len(verified["findings"]),
    }
(out / "airports.json").write_text(json.dumps(found, indent=1) + "\n")
END
