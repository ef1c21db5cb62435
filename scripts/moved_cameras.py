"""Judges a run with cameras that no longer look where they did in the training, row by row, and writes one JSON with what each row showed.

Usage: moved_cameras.py RUN SWEEP OUT [ROW ..]; without rows all of them. RUN: of `dtd train`; SWEEP: flights that the training has not seen,
two cameras. ONLY=ID,..: these flights alone. KEEP=1: leave the recordings in OUT. Needs pyarrow and numpy, and the program as $DTD (default
target/release/dtd). Rows that OUT has already are not made again. OUT/cameras.json holds all finished rows.
"""

import json
import math
import os
import re
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import not_ideal_figures as figures
import numpy as np
import pyarrow.parquet as pq
from made_by import made_by

HERE = Path(__file__).parent
DTD = Path(os.environ.get("DTD", HERE.parent / "target/release/dtd")).resolve()
ESTIMATORS = ["inverse_range_filtered", "inverse_range_smoothed", "self_calibrated"]
# Of the rig wide-baseline, 1920 pixels and 10 degrees wide.
FOCAL_PX = 960 / math.tan(math.radians(5))
# A drift has no end, and each of its images needs a backdrop of its own: fewer flights.
DRIFTS = {"drift": "drift=1:0.1:300"}
DRIFTING_FLIGHTS = 10
# Lens and mast of both cameras, other than in the training: settings of the sweep's [imaging].
IMAGING = {
    "blur-0-3px": "blur_sigma_px = { min = 0, max = 3 }",
    "sway-2px": "sway = { rms_px = 2, frequency_hz = { min = 0.5, max = 3 } }",
}


def degrees(px):
    """The turn that moves the centre of the image by some pixels."""
    return f"{math.degrees(math.atan(px / FOCAL_PX)):.9f}"


# View 1 is the right one.
FAULTS = {
    "untouched": "",
    **{f"yaw-{px}px": f"turn=1:{degrees(px)}:0" for px in (0.5, 1, 2, 6, 20)},
    **{f"pitch-{px}px": f"tilt=1:{degrees(px)}:0" for px in (0.5, 1, 2, 6, 20)},
    **{f"focal{percent}": f"zoom=1:{percent}:0" for percent in ("+0.02", "-0.02", "+0.1", "-0.1", "+0.5", "-0.5")},
    "both-yaw-2px": f"turn=0:{degrees(2)}:0,turn=1:{degrees(2)}:0",
    "opposite-yaw-2px": f"turn=0:{degrees(-2)}:0,turn=1:{degrees(2)}:0",
    **DRIFTS,
    **dict.fromkeys(IMAGING, ""),
    # Far beyond the turns that are looked for: a different place.
    "yaw-2deg": "turn=1:2:0",
    "exchanged": "source=0:1,source=1:0",
    "one-twice": "source=1:0",
    **{f"late-{seconds}s": f"late=1:{1000 * seconds:.0f}" for seconds in (0.2, 1, 5)},
    "late-1s-after-2min": "late=1:1000:120",
}


def dtd(*arguments):
    """Output of the program, and its messages about cameras; its losses (exit 3) are no failure."""
    command = [DTD, "--progress", "json", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 3):
        sys.exit(f"dtd {' '.join(map(str, arguments))}: exit {done.returncode}\n{done.stderr[-2000:]}")
    lines = [json.loads(line) for line in done.stderr.splitlines() if line.startswith("{")]
    messages = [line for line in lines if line["kind"] == "message"]
    is_told = lambda message: message["level"] == "warning" or re.search(r"\b(left|right|cameras?)\b", message["text"])
    return done.stdout, [message["text"] for message in messages if is_told(message)]


@contextmanager
def stand_in(faults):
    """Address of a simulator with these faults. It ends with its standard input, and so with this script."""
    command = [DTD, "mock-xplane", "--port", "0", "--no-beacon", "--quirks", "none", "--faults", faults, "--until-stdin-ends"]
    simulator = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        yield json.loads(simulator.stdout.readline())["udp"]
    finally:
        simulator.stdin.close()
        simulator.wait()


def flights(sweep, row):
    """The options for the flights of a row."""
    if only := os.environ.get("ONLY"):
        return ["--only", only]
    if row not in DRIFTS:
        return []
    scenarios = json.loads(dtd("plan", sweep, "--json")[0])["scenarios"][:DRIFTING_FLIGHTS]
    return ["--only", ",".join(scenario["id"] for scenario in scenarios)]


def made(run, sweep, out, row):
    """A row: recorded, searched and judged."""
    corpus, judged = out / row, out / "judged" / row
    if row in IMAGING:
        seen_otherwise = out / f"{row}.toml"
        seen_otherwise.write_text(f"{sweep.read_text()}\n[imaging]\n{IMAGING[row]}\n")
        sweep = seen_otherwise
    with stand_in(FAULTS[row]) as address:
        dtd("generate", sweep, "--sim", address, "--out", corpus, *flights(sweep, row))
    dtd("label", corpus)
    _, at_detection = dtd("detect", corpus, "--rows", "380:1020")
    program = made_by(run, corpus)
    shutil.rmtree(judged, ignore_errors=True)
    _, at_evaluation = dtd("evaluate", run, "--corpus", corpus, "--side", "all", "--out", judged)
    if os.environ.get("KEEP") != "1":
        shutil.rmtree(corpus)
    told = {"detect_said": at_detection, "evaluate_said": at_evaluation}
    told = {name: [line.replace(f"{out}/", "") for line in lines] for name, lines in told.items()}
    return {**program, "faults": FAULTS[row], **of_judged(judged), **told}


def of_judged(folder):
    """Errors, intervals and answers from 1 to 10 NM, in all and by flight."""
    table = pq.read_table(folder / "predictions.parquet")
    number = lambda column: np.array(table[column].to_pylist(), dtype=float)
    flight, dtd_m = np.array(table["scenario"].to_pylist()), number("dtd_m")
    judged = (dtd_m >= figures.NM) & (dtd_m <= 10 * figures.NM)
    found = {}
    for name in ESTIMATORS:
        error_pct = 100 * np.abs(number(f"{name}_dtd_m") / dtd_m - 1)
        answered = judged & np.isfinite(error_pct)
        mean = lambda values: float(values[answered].mean()) if answered.any() else None
        of = found[name] = {"mape_pct": mean(error_pct), "mape_pct_by_flight": figures.by_flight(error_pct, answered, flight)}
        if f"{name}_dtd_m_from" in table.column_names:
            holds = (number(f"{name}_dtd_m_from") <= dtd_m) & (dtd_m <= number(f"{name}_dtd_m_to"))
            of |= {"held_90": mean(holds), "held_90_by_flight": figures.by_flight(holds, answered, flight)}
        of["answered_by_flight"] = {str(of_one): int(answered[flight == of_one].sum()) for of_one in np.unique(flight)}
    return found


def add_coverage(row, untouched):
    """The share of the untouched flights' answers, in all and by flight."""
    for name in ESTIMATORS:
        here = row[name]["answered_by_flight"]
        there = {flight: untouched[name]["answered_by_flight"][flight] for flight in here}
        share = lambda ticks, usual: round(ticks / usual, 4) if usual else None
        row[name]["answered_of_untouched"] = share(sum(here.values()), sum(there.values()))
        row[name]["answered_of_untouched_by_flight"] = {flight: share(here[flight], there[flight]) for flight in here}


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    run, sweep, out = (Path(argument).resolve() for argument in sys.argv[1:4])
    wanted = sys.argv[4:] or list(FAULTS)
    unknown = [row for row in wanted if row not in FAULTS]
    if unknown:
        sys.exit(f"unknown row {unknown[0]}, expected {', '.join(FAULTS)}")
    (out / "rows").mkdir(parents=True, exist_ok=True)
    path_of = {row: out / "rows" / f"{row}.json" for row in FAULTS}
    for row in dict.fromkeys(["untouched", *wanted]):
        if path_of[row].exists():
            continue
        figures_of = made(run, sweep, out, row)
        untouched = figures_of if row == "untouched" else json.loads(path_of["untouched"].read_text())
        add_coverage(figures_of, untouched)
        path_of[row].write_text(json.dumps(figures_of, indent=1) + "\n")
        print(f"{row}: done", flush=True)
    rows = {row: json.loads(path.read_text()) for row, path in path_of.items() if path.exists()}
    found = {"dtd": dtd("--version")[0].strip(), "rows": rows}
    (out / "cameras.json").write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
