"""Runs `dtd detect` and search.py in turn on the same videos and prints their rates as a table. See benches/python_loop.sh.

    compare.py DTD CORPUS [MODEL.onnx]

The first scenario of the training side is searched, all of its views; the corpus must be labelled. SAHI gets a few images of each: it is
slow.
"""

import json
import os
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROUNDS = int(os.environ.get("ROUNDS", "3"))
OPTIONS = shlex.split(os.environ.get("DTD_OPTIONS", ""))
SAHI_PICTURES = 20
ALL = 1_000_000
HERE = Path(__file__).parent
WHOLE, PYTHON_WHOLE = "dtd detect --mode full", "Python, the same windows"
ROWS, PYTHON_ROWS = f"{WHOLE} --rows training", f"{PYTHON_WHOLE} as `--rows training`"


def copied(corpus, folder):
    """A copy of the corpus with the first scenario of its training side only, and that scenario's videos."""
    copy = folder / "corpus"
    (copy / "scenarios").mkdir(parents=True)
    for entry in corpus.iterdir():
        if entry.is_file():
            shutil.copy(entry, copy)
    sides = json.loads((corpus / "splits.json").read_text())["scenarios"]
    recorded = {done.parent.name for done in (corpus / "scenarios").glob("*/DONE.json")}
    of_training = [name for name in recorded if sides[name]["side"] == "train"]
    if not of_training:
        sys.exit(f"{corpus}: no complete scenario is on the training side; generate and label one")
    first = min(of_training)
    scenario = copy / "scenarios" / first
    shutil.copytree(corpus / "scenarios" / first, scenario, ignore=shutil.ignore_patterns("detections", "registrations", "health", "backgrounds"))
    return copy, sorted((scenario / "views").iterdir())


def bands_searched(corpus):
    """The bands of rows that the last `dtd detect` searched, as search.py takes them."""
    (record,) = corpus.glob("scenarios/*/detections/*.json")
    settings = json.loads(record.read_text())["settings"]
    bands = [(settings.get("rows"), 1), (settings.get("half_scale_rows"), 2)]
    return [[band["top_px"], band["bottom_px"], shrink] for band, shrink in bands if band]


def python(way, model, videos, most, bands=()):
    arguments = [sys.executable, HERE / "search.py", way, model, str(most), json.dumps(bands), *videos]
    run = subprocess.run(arguments, check=True, capture_output=True, text=True)
    spent = json.loads(run.stdout)
    return spent["pictures"], spent["boxes"], spent["seconds"], spent["cpu_seconds"]


def detect(dtd, corpus, model, *options):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.perf_counter()
    run = subprocess.run(
        [dtd, "detect", corpus, "--model", model, *options, *OPTIONS, "--force", "--json"],
        check=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    seconds = time.perf_counter() - began
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    counts = json.loads(run.stdout)["counts"]
    return counts["pictures"], counts["detections"], seconds, cpu


def main():
    dtd, corpus = sys.argv[1], Path(sys.argv[2])
    model = sys.argv[3] if len(sys.argv) > 3 else str(HERE.parent.parent / "models/aircraft.onnx")
    os.environ["ORT_DISABLE_TELEMETRY"] = "1"
    with tempfile.TemporaryDirectory() as folder:
        copy, videos = copied(corpus, Path(folder))
        ways = {
            PYTHON_WHOLE: lambda: python("plain", model, videos, ALL),
            "Python, SAHI's slices": lambda: python("sahi", model, videos, SAHI_PICTURES),
            WHOLE: lambda: detect(dtd, copy, model, "--mode", "full"),
            ROWS: lambda: detect(dtd, copy, model, "--mode", "full", "--rows", "training"),
            PYTHON_ROWS: lambda: python("plain", model, videos, ALL, bands_searched(copy)),
            "dtd detect --mode tracked": lambda: detect(dtd, copy, model, "--mode", "tracked"),
        }
        best = {}
        for _ in range(ROUNDS):
            for name, way in ways.items():
                pictures, boxes, seconds, cpu = way()
                rate, cpu_ms = pictures / seconds, 1000 * cpu / pictures
                old_rate, old_cpu_ms, _ = best.get(name, (0, float("inf"), 0))
                best[name] = (max(rate, old_rate), min(cpu_ms, old_cpu_ms), boxes / pictures)
    plain = best[PYTHON_WHOLE]
    print(f"{len(videos)} views, best of {ROUNDS} rounds each; {Path(model).name}")
    print("| | images/s | CPU ms per image | boxes per image | images/s, ratio to the plain loop | CPU, ratio |")
    print("|---|---|---|---|---|---|")
    for name, (rate, cpu_ms, boxes) in best.items():
        print(f"| {name} | {rate:.1f} | {cpu_ms:.1f} | {boxes:.2f} | {rate / plain[0]:.2f} | {plain[1] / cpu_ms:.2f} |")
    print(f"{ROWS}: {best[ROWS][0] / best[PYTHON_ROWS][0]:.2f} times the images/s of the plain loop on the same rows")


main()
