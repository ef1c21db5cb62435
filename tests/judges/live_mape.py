"""Errors of `dtd estimate` over RTSP in real time, beside the same videos read as files.

    live_mape.py DTD RUN CORPUS FOLDER

Judges the lines that `live_hours.py DTD RUN CORPUS FOLDER arrivals` has left in FOLDER, and prints JSON: the mean relative error of fresh
distances (1 to 10 NM) of each arrival both ways, against the labels. The program counts time from its first image, which is not the first one
of the video: one offset of time is fitted to each arrival, and printed. Needs pyarrow.
"""

import json
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as parquet
from live_feeds import sources

# Each arrival has so many seconds in the feeds.
EACH_S = 300
NM_M, MOST_MS = 1852, 600


def truth_of(scenario):
    table = parquet.read_table(scenario / "frames.parquet", columns=["time_ns", "dtd_m"]).to_pydict()
    return [(ns * 1e-9, dtd) for ns, dtd in zip(table["time_ns"], table["dtd_m"])]


def true_m(truth, at_s):
    """By a straight line between two ticks."""
    step_s = truth[1][0] - truth[0][0]
    place = (at_s - truth[0][0]) / step_s
    index = int(place)
    if place < 0 or index + 1 >= len(truth):
        return None
    part = place - index
    return truth[index][1] * (1 - part) + truth[index + 1][1] * part


def mape(answers, truth, late_s=0.0):
    found = []
    for at_s, dtd_m in answers:
        expected = true_m(truth, at_s - late_s)
        if expected is not None and NM_M <= expected <= 10 * NM_M:
            found.append(abs(dtd_m / expected - 1))
    return (100 * sum(found) / len(found), len(found)) if found else (None, 0)


def fresh(lines):
    lines = [json.loads(line) for line in lines]
    return [(line["time_s"], line["dtd_m"]) for line in lines if line.get("state") == "fresh" and line["dtd_m"] is not None]


def main():
    dtd, run, corpus, folder = sys.argv[1:]
    scenarios = sorted(path.parent for path in Path(corpus).glob("scenarios/*/DONE.json"))
    live = fresh((Path(folder) / "lines.jsonl").read_text().splitlines())
    arrivals, online = [], {}
    for place in range(int(live[-1][0] // EACH_S) + 1):
        scenario = scenarios[place % len(scenarios)]
        truth = truth_of(scenario)
        if scenario.name not in online:
            views = json.loads((scenario / "scenario.json").read_text())["views"]
            of_corpus = sources({view: f"corpus:{corpus}/{scenario.name}" for view in views})
            command = [dtd, "estimate", run, *of_corpus, "--as-fast-as-possible"]
            read = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()
            online[scenario.name] = mape(fresh(read), truth)
        of_this = [(at_s - EACH_S * place + truth[0][0], dtd_m) for at_s, dtd_m in live if at_s // EACH_S == place]
        tried = [(*mape(of_this, truth, late_ms * 1e-3), late_ms) for late_ms in range(-MOST_MS, MOST_MS + 1)]
        over, answers, late_ms = min(tried, key=lambda found: (found[0] is None, found))
        file_mape, file_answers = online[scenario.name]
        arrivals.append(
            {
                "scenario": scenario.name,
                "file_mape_percent": file_mape,
                "file_answers": file_answers,
                "rtsp_mape_percent": over,
                "rtsp_answers": answers,
                "fitted_offset_ms": late_ms,
            }
        )
    ratios = [arrival["rtsp_mape_percent"] / arrival["file_mape_percent"] for arrival in arrivals]
    print(json.dumps({"mean_ratio": sum(ratios) / len(ratios), "arrivals": arrivals}, indent=1))


main()
