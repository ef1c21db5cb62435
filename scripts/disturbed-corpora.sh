#!/usr/bin/env bash
# Records the same eight approaches at an image every two seconds, once as they are, once with each fault of the right camera (0.49, 0.45
# or 0.2 s late, shaking by 2 px RMS, 4 % of the images frozen, turned by 0.3 degrees in mid flight), and through air that tilts images by
# 2" and 5" at 10 km, or by the preset tower-camera. Two more corpora have other vertical profiles. The stand-in draws the faults
# (`dtd mock-xplane --faults`); tables and calibration do not mention them. All corpora are labelled and detected. No part of the shake is a
# multiple of the image rate: it would look like a turn.
# Usage: scripts/disturbed-corpora.sh OUT [NAME ..]; without names all of them. Run it again to resume. ONLY=ID,.. records these approaches
# alone.
set -euo pipefail
cd "$(dirname "$0")/.."

[ $# -gt 0 ] || { sed -n '2,8s/^# //p' "$0" >&2; exit 2; }
out=$1
shift
dtd=${DTD:-${CARGO_TARGET_DIR:-target}/release/dtd}
[ -x "$dtd" ] || cargo build --release --locked
mkdir -p "$out"

declare -A faults=(
    [untouched]=""
    [late-490ms]="late=1:490"
    [late-450ms]="late=1:450"
    [late-200ms]="late=1:200"
    [shake-2px]="shake=1:2:1.7"
    [frozen-4pct]="stick=1:0.04"
    [turned-0.3deg]="turn=1:0.3:120"
    [tilt-2arcsec]="" [tilt-5arcsec]="" [tower-camera]="" [step-down]="" [continuous-descent]=""
)
declare -A imaging=(
    [tilt-2arcsec]=$'[imaging.seeing]\ntilt_rms_arcsec = 2'
    [tilt-5arcsec]=$'[imaging.seeing]\ntilt_rms_arcsec = 5'
    [tower-camera]=$'[imaging]\npreset = "tower-camera"'
)
# Vertical profiles that the demo does not fly.
declare -A profile=([step-down]=step-down [continuous-descent]=continuous)
[ $# -gt 0 ] || set -- untouched late-490ms late-450ms late-200ms shake-2px frozen-4pct turned-0.3deg tilt-2arcsec tilt-5arcsec tower-camera \
    step-down continuous-descent
for name; do
    [ -n "${faults[$name]+known}" ] || { echo "unknown corpus $name; expected one of ${!faults[*]}" >&2; exit 2; }
done

sed -e 's/^name = .*/name = "disturbed"/' -e 's/^seed = 20 .*/seed = 40/' -e 's/^frame_rate = 30 .*/frame_rate = "1\/2"/' \
    -e 's/^times = .*/times = ["08:00", "17:00"]/' -e 's/^repeats = .*/repeats = 1/' scenarios.toml >"$out/disturbed.toml"

for name; do
    flown=${profile[$name]:-level-then-glide-path}
    printf '%s\n' "$(sed "s/^profiles = .*/profiles = [\"$flown\"]/" "$out/disturbed.toml")" "${imaging[$name]:-}" >"$out/$name.toml"
    # It ends with its standard input, and so with this script.
    coproc SIMULATOR { exec "$dtd" mock-xplane --port 0 --no-beacon --quirks none --faults "${faults[$name]}" --until-stdin-ends; }
    simulator=$SIMULATOR_PID
    read -r addresses <&"${SIMULATOR[0]}"
    address=$(python3 -c 'import json, sys; print(json.loads(sys.argv[1])["udp"])' "$addresses")
    "$dtd" generate "$out/$name.toml" --sim "$address" --out "$out/$name" ${ONLY:+--only "$ONLY"}
    kill "$simulator"
    wait "$simulator" || true
    "$dtd" label "$out/$name"
    # The rows in which the aircraft are.
    "$dtd" detect "$out/$name" --rows 380:1020
done
