#!/usr/bin/env bash
# Compares the time that `dtd plan` expects with the time that recording then takes with the stand-in, in two cases: ten scenarios at full
# size, and twelve small ones.
# Prints the parts that the plan expects, and expected over taken. On an idle machine: everything that runs beside it is in the second.
# Usage: scripts/plan-accuracy.sh [full|small ..]; both take about ten minutes.
set -euo pipefail
cd "$(dirname "$0")/.."

dtd=${DTD:-target/release/dtd}
[ -x "$dtd" ] || cargo build --release --locked
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

compare() { # NAME SWEEP SIMULATOR
    "$dtd" plan "$2" --sim "$3" --json >"$work/plan" 2>/dev/null
    local began took
    began=$(date +%s%N)
    "$dtd" generate "$2" --sim "$3" --out "$work/$1" >"$work/said" 2>&1 || { cat "$work/said" >&2; exit 1; }
    took=$((($(date +%s%N) - began) / 1000000))
    python3 - "$1" "$took" "$work/plan" <<'PY'
import json, sys
name, took_ms, plan = sys.argv[1:]
estimate = json.load(open(plan))["estimate"]
parts = ["pictures", "live_flying", "loading", "weather"]
seconds = {part: 3600 * estimate[part + "_h"] for part in parts}
expected = 3600 * estimate["making_h"]
print(f"{name}: {estimate['scenarios']} scenarios, {estimate['pictures']} pictures: expected {expected:.1f} s, took {int(took_ms) / 1000:.1f} s, "
      f"ratio {1000 * expected / int(took_ms):.2f}; " + ", ".join(f"{part} {s:.1f}" for part, s in seconds.items()))
PY
}

# The weathers of the demo, so that all of them are in it, at another size and rate.
small() {
    sed -e 's/^width_px = .*/width_px = 480/' -e 's/^height_px = .*/height_px = 320/' -e 's/^frame_rate = .*/frame_rate = 2/' \
        -e "s|\"tests/data|\"$PWD/tests/data|" demo.toml >"$work/small.toml"
    compare small "$work/small.toml" mock
}

full() { compare full demo.toml mock; }

echo "load before: $(cut -d ' ' -f 1-3 /proc/loadavg), $(nproc) cores"
[ $# -gt 0 ] || set -- full small
for name; do "$name"; done
echo "load after: $(cut -d ' ' -f 1-3 /proc/loadavg)"
