"""Cuts sightings.csv from a corpus of `dtd demo`: make.py CORPUS. Needs pyarrow.

Of the first four scenarios, each second: a point of the aircraft in the left view, the same point in the right one by the registration, and
the width of the box there.
"""

import csv
import sys
from pathlib import Path

import pyarrow.parquet as parquet

ARRIVALS = 4


def rows(scenario):
    (registered,), (detected,) = ((scenario / folder).glob("*.parquet") for folder in ("registrations", "detections"))
    boxes = [box for box in parquet.read_table(detected).to_pylist() if box["view"] == "right" and box["counts_live"]]
    widths = {box["tick"]: box["width_px"] for box in sorted(boxes, key=lambda box: box["score"])}
    times = parquet.read_table(scenario / "frames.parquet", columns=["time_ns"])["time_ns"].to_pylist()
    for row in parquet.read_table(registered).to_pylist():
        if row["reason"] is None and row["tick"] in widths:
            left = (row["x_px"], row["y_px"])
            right = (row["x_px"] + row["dx_px"], row["y_px"] + row["dy_px"])
            places = [f"{place:.3f}" for place in (*left, *right)]
            yield [scenario.name, f"{times[row['tick']] * 1e-9:.3f}", *places, f"{widths[row['tick']]:.1f}"]


def main():
    scenarios = sorted(path.parent for path in Path(sys.argv[1]).glob("scenarios/*/DONE.json"))
    with Path(__file__).with_name("sightings.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["arrival", "time_s", "left_x_px", "left_y_px", "right_x_px", "right_y_px", "width_px"])
        for scenario in scenarios[:ARRIVALS]:
            table.writerows(rows(scenario))


main()
