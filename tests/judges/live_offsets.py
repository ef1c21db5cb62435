"""The offset of two cameras' clocks, as `dtd estimate` measures it: arrivals of a corpus, one after the other in a file for each view, of
which the second begins half a second later and runs 100 ppm fast.

    live_offsets.py DTD RUN CORPUS FOLDER [SCENARIO ...]

Prints JSON: each offset that was told with its error and its stated deviation, and the mean error of the distances of each arrival (1 to
10 NM) beside that of the same files without an offset. FOLDER keeps the files. Needs ffmpeg and pyarrow.
"""

import json
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as parquet

OFFSET_S, DRIFT = 0.5, 100e-6
GAP_S = 90
NM_M = 1852


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


def lines_of(dtd, run, left, right, *more):
    command = [dtd, "estimate", run, "--view", f"left={left}", "--view", f"right={right}", "--as-fast-as-possible", *more]
    ran = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return [json.loads(line) for line in ran.stdout.splitlines()]


def errors(lines, scenarios, began_s):
    """Mean relative error of each arrival, percent, with the number of answers and of those from both views."""
    found = []
    for scenario, at_s in zip(scenarios, began_s):
        table = parquet.read_table(scenario / "frames.parquet", columns=["time_ns", "dtd_m"]).to_pydict()
        truth = {round((ns - table["time_ns"][0]) * 1e-6): dtd for ns, dtd in zip(table["time_ns"], table["dtd_m"])}
        relative, both = [], 0
        for line in lines:
            if line.get("state") != "fresh" or line["dtd_m"] is None:
                continue
            true_m = truth.get(round((line["time_s"] - at_s) * 1e3))
            if true_m is not None and NM_M <= true_m <= 10 * NM_M:
                relative.append(abs(line["dtd_m"] / true_m - 1))
                both += len(line["views"]) == 2
        mean = 100 * sum(relative) / len(relative) if relative else None
        found.append({"answers": len(relative), "from_both_views": both, "mape_percent": mean})
    return found


def main():
    dtd, run, corpus, folder = sys.argv[1], sys.argv[2], Path(sys.argv[3]), Path(sys.argv[4])
    folder.mkdir(parents=True, exist_ok=True)
    wanted = sys.argv[5:] or sorted(path.name for path in (corpus / "scenarios").iterdir() if (path / "DONE.json").exists())
    scenarios = [corpus / "scenarios" / name for name in wanted]
    left, began_s = compose(scenarios, "left", folder)
    right, _ = compose(scenarios, "right", folder)
    shifted = folder / "right-shifted.mp4"
    copy("-itsoffset", OFFSET_S, "-itsscale", 1 + DRIFT, "-i", right, shifted)
    kept = folder / "offsets.json"
    kept.unlink(missing_ok=True)
    measured = ["--offset", "right=auto", "--keep-offsets", str(kept)]
    ideal = lines_of(dtd, run, left, right)
    lines = lines_of(dtd, run, left, shifted, *measured)
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
    again = lines_of(dtd, run, left, shifted, *measured)
    first = next(line for line in again if line.get("event") == "offset")
    result = {
        "offsets": offsets,
        "arrivals": errors(lines, scenarios, began_s),
        "without_offset": errors(ideal, scenarios, began_s),
        "kept": json.loads(kept.read_text()),
        "first_of_next_start": first,
    }
    print(json.dumps(result, indent=1))


main()
