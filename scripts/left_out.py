"""Judges formulas in a weather, or at a time of day, that the training left out: one training for each of a corpus, and one with all.

Usage: left_out.py CORPUS OUT [TRAIN ARGUMENTS ..]; the program is $DTD. OUT/left-out.json has errors, coverage and intervals. Finished
trainings are not repeated. The networks are hardly trained.
"""

import json
import sys
from pathlib import Path

from not_ideal import train

ESTIMATORS = ["inverse_range", "inverse_range_filtered", "inverse_range_smoothed", "self_calibrated"]


def conditions(corpus):
    """Settings of --leave-out."""
    records = [json.loads(path.read_text())["conditions"] for path in corpus.glob("scenarios/*/scenario.json")]
    weathers = sorted({record["weather_name"] for record in records})
    times = sorted({record["time_of_day"] for record in records})
    return [*(f"weather={name}" for name in weathers), *(f"time={name}" for name in times)]


def figures(row, run):
    """The figures of a row of not_ideal.py that do not depend on an untouched corpus, and errors by weather and time."""
    kept = ("mape_pct", "median_pct", "p95_pct", "coverage", "coverage_in_sight")
    of = {name: {key: row[name][key] for key in kept} for name in ESTIMATORS}
    metrics = json.loads((run / "metrics.json").read_text())["estimators"]
    for name in ESTIMATORS:
        for by in ("by_weather", "by_time"):
            of[name][by] = {condition: found["mape_pct"] for condition, found in metrics[name][by].items()}
    for name in ESTIMATORS[1:3]:
        shares = row[name]["intervals_90"]
        of[name]["intervals_held"] = shares["held"]
        of[name]["intervals_held_by_flight"] = shares["held_by_flight"]
    return {"commit": row["commit"], "versions": row["versions"], "ticks": row["ticks"], **of}


def main():
    corpus, out = (Path(argument).resolve() for argument in sys.argv[1:3])
    (out / "rows").mkdir(parents=True, exist_ok=True)
    made = {}
    for setting in ["nothing", *conditions(corpus)]:
        path = out / "rows" / f"{setting}.json"
        if not path.exists():
            left_out = [] if setting == "nothing" else ["--leave-out", setting]
            row = train(corpus, out / "run", *left_out, *sys.argv[3:])
            path.write_text(json.dumps(figures(row, out / "run")))
            print(f"{setting}: done", flush=True)
        made[setting] = json.loads(path.read_text())
    (out / "left-out.json").write_text(json.dumps(made, indent=1) + "\n")


main()
