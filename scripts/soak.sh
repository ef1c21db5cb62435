#!/usr/bin/env bash
# Runs `dtd generate` and periodically prints the resident memory and the processor time of the command and of its stand-ins;
# at the end the maxima, frames per second, processor milliseconds per frame and bytes per scenario.
# Usage: scripts/soak.sh SECONDS_BETWEEN CORPUS arguments of generate.., e.g. scripts/soak.sh 60 corpus scenarios.toml --sim mock:2
set -euo pipefail
cd "$(dirname "$0")/.."

every=$1 corpus=$2
shift 2
dtd=${DTD:-target/release/dtd}
[ -x "$dtd" ] || cargo build --release --locked

rss_mb() { awk '/^VmRSS/ { sum += $2 } END { printf "%.0f", sum / 1024 }' "$@" /dev/null 2>/dev/null || echo 0; }
# User and system time of a process, of all its threads, in hundredths of a second.
cpu() { awk '{ sum += $14 + $15 } END { print sum + 0 }' "$@" /dev/null 2>/dev/null || echo 0; }

began=$(date +%s)
"$dtd" generate --out "$corpus" --json "$@" >/tmp/soak.$$.json 2>/tmp/soak.$$.log &
run=$!
max_dtd=0 max_sim=0 cpu_dtd=0 cpu_sim=0 next=0
echo "seconds  dtd_mb  stand_in_mb  whole_scenarios"
while kill -0 "$run" 2>/dev/null; do
    sims=$(pgrep -P "$run" || true)
    sim_status=() sim_stat=()
    for sim in $sims; do
        sim_status+=("/proc/$sim/status")
        sim_stat+=("/proc/$sim/stat")
    done
    m=$(rss_mb "/proc/$run/status") && s=$(rss_mb "${sim_status[@]}")
    ((m > max_dtd)) && max_dtd=$m
    ((s > max_sim)) && max_sim=$s
    c=$(cpu "/proc/$run/stat") && ((c > cpu_dtd)) && cpu_dtd=$c
    c=$(cpu "${sim_stat[@]}") && ((c > cpu_sim)) && cpu_sim=$c
    now=$(($(date +%s) - began))
    if ((now >= next)); then
        whole=$( (find "$corpus/scenarios" -mindepth 1 -maxdepth 1 ! -name '*.partial' 2>/dev/null || true) | wc -l)
        printf '%7d %7d %12d %16d\n' "$now" "$m" "$s" "$whole"
        next=$((now + every))
    fi
    sleep 1
done
code=0
wait "$run" || code=$?
seconds=$(($(date +%s) - began))
python3 - "$corpus" "/tmp/soak.$$.json" "$seconds" "$max_dtd" "$max_sim" "$cpu_dtd" "$cpu_sim" <<'PY'
import json, pathlib, sys
corpus, outcome, seconds, max_dtd, max_sim, cpu_dtd, cpu_sim = sys.argv[1:]
made = json.load(open(outcome))["committed"]
frames = size = 0
for id in made:
    folder = pathlib.Path(corpus, "scenarios", id)
    record = json.load(open(folder / "scenario.json"))
    frames += record["ticks"] * len(record["views"])
    bytes_ = sum(f.stat().st_size for f in folder.rglob("*") if f.is_file())
    size += bytes_
    print(f"{id}: {record['ticks']} ticks, {bytes_ / 1e6:.1f} MB, {bytes_ / record['ticks'] / len(record['views']) / 1e3:.1f} kB per frame")
print(f"most memory: dtd {max_dtd} MB, stand-ins {max_sim} MB")
if frames:
    print(f"{frames} frames in {seconds} s: {frames / int(seconds):.1f} frames/s, {size / len(made) / 1e6:.0f} MB per scenario")
    print(f"processor time per frame: dtd {int(cpu_dtd) * 10 / frames:.1f} ms, stand-ins {int(cpu_sim) * 10 / frames:.1f} ms")
PY
tail -n 3 "/tmp/soak.$$.log" >&2
rm -f "/tmp/soak.$$.json" "/tmp/soak.$$.log"
exit "$code"
