#!/usr/bin/env bash
# Speed of a replay: records four weathers with the stand-in, replays the tape, and prints the time of both and their ratio, round by
# round. DTD names another program than target/release/dtd, ROUNDS another number than 3.
set -euo pipefail
cd "$(dirname "$0")/.."

dtd=${DTD:-target/release/dtd}
work=$(mktemp -d)
recorder=
trap 'kill $recorder 2>/dev/null || true; rm -rf "$work"' EXIT

cat >"$work/sweep.toml" <<SWEEP
[corpus]
name = "weathers"
seed = 5
[approach]
airport = "WSSS"
runway = "02L"
aircraft = "B737-800"
rig = "wide-baseline"
[grid]
times = ["12:00"]
weathers = ["clear", "cloudy", "foggy", "stormy"]
repeats = 1
day_of_year = 172
utc_offset_h = 8
[picture]
width_px = 480
height_px = 320
frame_rate = 2
[[recorded]]
files = "$PWD/tests/data/flights/01_calm_ils.csv"
weathers = ["clear", "cloudy", "foggy", "stormy"]
[start]
dtd_nm = 2
[weather.clear]
visibility_m = 80000
wind_speed_mps = 4
wind_from_true_deg = 60
[weather.cloudy]
visibility_m = 50000
clouds = [{ kind = "cumulus", cover_ratio = 0.5, base_msl_m = 900, top_msl_m = 2000 }]
[weather.foggy]
visibility_m = 9260
[weather.stormy]
visibility_m = 35000
clouds = [{ kind = "cumulonimbus", cover_ratio = 0.9, base_msl_m = 600, top_msl_m = 5000 }]
rain_ratio = 0.6
wind_speed_mps = 9
wind_from_true_deg = 340
SWEEP

# Runs a command, which must succeed and warn of nothing, and prints its seconds.
seconds_of() {
    local began ended
    began=$(date +%s.%N)
    "$@" >"$work/said" 2>&1 || { cat "$work/said" >&2; return 1; }
    ended=$(date +%s.%N)
    if grep -E "WARN|marked" "$work/said" >&2; then
        return 1
    fi
    echo "$began $ended" | awk '{ printf "%.1f", $2 - $1 }'
}

echo "| round | recorded, s | replayed, s | ratio |"
echo "|---|---|---|---|"
for round in $(seq "${ROUNDS:-3}"); do
    # The recorder ends with its input, also if this script is killed.
    mkfifo "$work/$round.end"
    "$dtd" tape --sim mock --port 0 --until-stdin-ends --out "$work/$round.mcap" <"$work/$round.end" >"$work/$round.ready" 2>/dev/null &
    recorder=$!
    exec 3>"$work/$round.end"
    for _ in $(seq 300); do
        grep -q '"udp"' "$work/$round.ready" && break
        sleep 0.1
    done
    address=$(sed 's/.*"udp":"\([^"]*\)".*/\1/' "$work/$round.ready")
    recorded=$(seconds_of "$dtd" generate "$work/sweep.toml" --out "$work/$round" --sim "$address")
    exec 3>&-
    wait "$recorder"
    recorder=
    replayed=$(seconds_of "$dtd" generate "$work/sweep.toml" --out "$work/$round-again" --sim "tape:$work/$round.mcap")
    echo "$round $recorded $replayed" | awk '{ printf "| %d | %s | %s | %.2f |\n", $1, $2, $3, $3 / $2 }'
done
