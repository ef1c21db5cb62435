#!/usr/bin/env bash
# Trains at one airport and judges at another: 12 approaches at the first, 6 at the second (tests/data/airport.toml at full size), with the
# same rig relative to the runway. OUT/cross-airport.json has the errors at both.
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
corpus "$here" 4
corpus "$there" 2
[ -e "$out/run/run.json" ] || "$dtd" train "$out/${here%/*}" --out "$out/run" --quick
[ -e "$out/here" ] || "$dtd" evaluate "$out/run" --corpus "$out/${here%/*}" --out "$out/here"
[ -e "$out/there" ] || "$dtd" evaluate "$out/run" --corpus "$out/${there%/*}" --side all --out "$out/there"
python3 - "$out" "$here" "$there" <<'END'
import json
import pathlib
import sys

out = pathlib.Path(sys.argv[1])
found = {"trained_at": sys.argv[2], "judged_at": sys.argv[3], "mape_pct": {}}
here, there = (json.loads((out / name / "metrics.json").read_text()) for name in ("here", "there"))
found["ticks"] = {"trained_at": here["ticks"], "judged_at": there["ticks"]}
for name, figures in here["estimators"].items():
    errors = [side["estimators"].get(name, {}).get("mape_pct") for side in (here, there)]
    found["mape_pct"][name] = dict(zip(("trained_at", "judged_at"), errors))
    print(name, *errors)
(out / "cross-airport.json").write_text(json.dumps(found, indent=1) + "\n")
END
