#!/usr/bin/env bash
# The cost of checking: processor time of `label`, `train` and `evaluate` with two builds of the command, on one corpus, alternating in one
# run, so that other work on the machine affects both. Usage: scripts/checking-cost.sh OLD NEW [ROUNDS] [SWEEP.toml]
#
# NEW makes the corpus, from tests/data/chain.toml unless another sweep is given. Prints the median of each verb for both, and the ratio of their sums.
# Build both alike, without CARGO_INCREMENTAL. Training uses one thread here: idle threads of a pool spin, for as long as other work keeps the machine busy.
set -euo pipefail
cd "$(dirname "$0")/.."

export RAYON_NUM_THREADS=1
old=$(realpath "$1") new=$(realpath "$2") rounds=${3:-5} sweep=${4:-tests/data/chain.toml}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$new" generate "$sweep" --out "$work/unlabelled" >/dev/null
cp -r "$work/unlabelled" "$work/corpus"
"$new" label "$work/corpus" >/dev/null
"$new" detect "$work/corpus" --model models/aircraft.onnx >/dev/null

python3 - "$old" "$new" "$rounds" "$work" <<'PY'
import os, pathlib, resource, shutil, statistics, subprocess, sys

old, new, rounds, work = sys.argv[1], sys.argv[2], int(sys.argv[3]), pathlib.Path(sys.argv[4])

def cpu_s(*command):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

took = {verb: {"old": [], "new": []} for verb in ("label", "train", "evaluate")}
for number in range(rounds):
    builds = [("old", old), ("new", new)]
    for name, dtd in builds if number % 2 == 0 else builds[::-1]:
        place, run = work / "copy", work / f"run-{name}"
        shutil.rmtree(place, ignore_errors=True)
        shutil.rmtree(run, ignore_errors=True)
        shutil.copytree(work / "unlabelled", place)
        took["label"][name].append(cpu_s(dtd, "label", place))
        took["train"][name].append(cpu_s(dtd, "train", work / "corpus", "--out", run, "--quick"))
        took["evaluate"][name].append(cpu_s(dtd, "evaluate", run, "--corpus", work / "corpus"))
print("processor seconds, medians of", rounds, "rounds")
total = {"old": 0.0, "new": 0.0}
for verb, times in took.items():
    median = {name: statistics.median(values) for name, values in times.items()}
    for name in total:
        total[name] += median[name]
    print(f"{verb:9} {median['old']:8.3f} {median['new']:8.3f}   {100 * (median['new'] / median['old'] - 1):+.1f} %")
print(f"{'together':9} {total['old']:8.3f} {total['new']:8.3f}   {100 * (total['new'] / total['old'] - 1):+.1f} %")
PY
