"""Errors of `dtd estimate` over RTSP in real time.

    live_mape.py CORPUS FOLDER

Judges the lines that `live_hours.py DTD RUN CORPUS FOLDER arrivals` has left in FOLDER, and prints JSON: the mean relative error of fresh
distances (1 to 10 NM) of each arrival against the labels, of all answers and of those from both views. Times of images are in UTC, and the
server has told when the videos began. `live_offsets.py` has the errors from files (`without_offset`). Needs pyarrow.
"""

import json
import sys
from datetime import datetime
from pathlib import Path

from live_truth import errors, mean, truth_of

# Each arrival has so many seconds in the feeds, after an empty scene of so many.
EACH_S, EVERY_S, LEAD_S = 300, 10, 20


def main():
    corpus, folder = map(Path, sys.argv[1:])
    scenarios = sorted(path.parent for path in corpus.glob("scenarios/*/DONE.json"))
    began_s = float((folder / "playing.txt").read_text().split()[1])
    count = round(len(json.loads((folder / "memory.json").read_text())) * EVERY_S / EACH_S)
    answers = []
    for line in map(json.loads, (folder / "lines.jsonl").read_text().splitlines()):
        if line.get("state") == "fresh" and line["dtd_m"] is not None:
            at_s = datetime.fromisoformat(line["time_utc"]).timestamp() - began_s - LEAD_S
            answers.append((at_s, line["dtd_m"], len(line["views"])))
    arrivals, of_all = [], {"all": [], "both_views": []}
    for place in range(count):
        scenario = scenarios[place % len(scenarios)]
        truth = truth_of(scenario)

        def of_this(views):
            here = [answer for answer in answers if answer[0] // EACH_S == place and answer[2] >= views]
            return errors([(at_s - EACH_S * place + truth[0][0], dtd_m) for at_s, dtd_m, _ in here], truth)

        found = {"all": of_this(1), "both_views": of_this(2)}
        for name, of_them in found.items():
            of_all[name].append(of_them)
        found = {name: {"answers": len(of_them), "mape_percent": mean(of_them)} for name, of_them in found.items()}
        arrivals.append({"scenario": scenario.name, **found})
    means = {name: {"mape_percent": mean(sum(each, []))} for name, each in of_all.items()}
    print(json.dumps({"mean": means, "arrivals": arrivals}, indent=1))


main()
