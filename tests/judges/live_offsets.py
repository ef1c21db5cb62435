"""The offset of two cameras' clocks, as `dtd estimate` measures it: arrivals of a corpus, one after the other in a file for each view, of
which the second begins half a second later and runs 100 ppm fast.

    live_offsets.py [--real-time | --judge] DTD RUN CORPUS FOLDER [SCENARIO ...]

Prints JSON: each offset that was told with its error and its stated deviation, and the mean error of the distances of each arrival (1 to
10 NM) beside that of the same files without an offset. The files are read as fast as possible; with --real-time, they are played; with
--judge, lines that an earlier call with the same arguments has left in FOLDER are judged again. Needs ffmpeg and pyarrow.
"""

import json
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as parquet
from live_truth import errors, mean, truth_of

OFFSET_S, DRIFT = 0.5, 100e-6
GAP_S = 90


def compose(scenarios, view, folder):
    """Joins the videos of a view, with gaps, and returns the file and the times at which the arrivals begin."""
    listed, began_s, at_s = [], [], 0.0
    for scenario in scenarios:
        rate = json.loads((scenario / "scenario.json").read_text())["frame_rate"]
        ticks = parquet.read_metadata(scenario / "frames.parquet").num_rows
        lasts_s = ticks * rate["denominator"] / rate["numerator"] + GAP_S
        listed.append(f"file '{(scenario / 'views' / f'{view}.mp4').resolve()}'\nduration {lasts_s}\n")
        began_s.append(at_s)
        at_s += lasts_s
    playlist = folder / f"{view}.txt"
    playlist.write_text("".join(listed))
    path = folder / f"{view}.mp4"
    copy("-f", "concat", "-safe", "0", "-i", playlist, path)
    return path, began_s


def copy(*arguments):
    *source, path = map(str, arguments)
    command = ["ffmpeg", "-v", "error", "-y", *source, "-c", "copy", "-video_track_timescale", "90000", path]
    subprocess.run(command, check=True)


def run_program(path, dtd, run, left, right, *more):
    command = [dtd, "estimate", run, "--view", f"left={left}", "--view", f"right={right}", *more]
    with path.open("w") as output:
        subprocess.run(command, stdout=output, check=True)


def lines_in(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def errors_by_arrival(lines, scenarios, began_s):
    """Mean relative error of each arrival, percent, with the number of answers and of those from both views."""
    found = []
    for scenario, at_s in zip(scenarios, began_s):
        truth = truth_of(scenario)
        # When files are played, each image waits half a second for the other view's: then no answer is fresh.
        of_this = [line for line in lines if line.get("views") and line["dtd_m"] is not None and line["time_s"] >= at_s]
        judged = [(len(line["views"]), errors([(line["time_s"] - at_s + truth[0][0], line["dtd_m"])], truth)) for line in of_this]
        relative = [error for _, found_here in judged for error in found_here]
        both = sum(views == 2 and bool(found_here) for views, found_here in judged)
        found.append({"answers": len(relative), "from_both_views": both, "mape_percent": mean(relative)})
    return found


def main():
    mode = sys.argv.pop(1) if sys.argv[1].startswith("--") else None
    dtd, run, corpus, folder, *wanted = sys.argv[1:]
    corpus, folder = Path(corpus), Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    wanted = wanted or sorted(path.name for path in (corpus / "scenarios").iterdir() if (path / "DONE.json").exists())
    scenarios = [corpus / "scenarios" / name for name in wanted]
    left, began_s = compose(scenarios, "left", folder)
    right, _ = compose(scenarios, "right", folder)
    kept, measured, ideal = (folder / name for name in ("offsets.json", "shifted.jsonl", "ideal.jsonl"))
    if mode != "--judge":
        shifted = folder / "right-shifted.mp4"
        copy("-itsoffset", OFFSET_S, "-itsscale", 1 + DRIFT, "-i", right, shifted)
        kept.unlink(missing_ok=True)
        fast = [] if mode == "--real-time" else ["--as-fast-as-possible"]
        run_program(measured, dtd, run, left, shifted, "--offset", "right=auto", "--keep-offsets", str(kept), *fast)
        run_program(ideal, dtd, run, left, right, *fast)
    lines, ideal = lines_in(measured), lines_in(ideal)
    offsets = []
    for line in lines:
        if line.get("event") == "offset" and line["offset_s"] is not None:
            true_s = -(OFFSET_S + DRIFT * line["time_s"])
            offsets.append(
                {
                    "time_s": line["time_s"],
                    "arrivals": sum(line["time_s"] >= at_s for at_s in began_s),
                    "offset_s": line["offset_s"],
                    "sd_s": line["sd_s"],
                    "error_ms": 1e3 * (line["offset_s"] - true_s),
                    "error_in_sd": (line["offset_s"] - true_s) / line["sd_s"],
                    "drift_ppm": line["drift_ppm"],
                    "drift_sd_ppm": line["drift_sd_ppm"],
                }
            )
    result = {
        "offsets": offsets,
        "arrivals": errors_by_arrival(lines, scenarios, began_s),
        "without_offset": errors_by_arrival(ideal, scenarios, began_s),
        "kept": json.loads(kept.read_text()),
    }
    print(json.dumps(result, indent=1))


main()
