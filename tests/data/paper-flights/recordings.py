#!/usr/bin/env python3
"""Writes the flights of a corpus as recordings (CSV) beside this script.

    python3 tests/data/paper-flights/recordings.py CORPUS

Every second tick is kept, and the last one: the images are not used, and the simulator interpolates between rows.

The autopilot of the computed flights holds the localizer within a metre, which no two arrivals share: the image position in one view would
reveal the distance. Each flight is therefore moved by an offset of its own, to the side and in height, which fades in the last mile. Real
arrivals scatter by 1 to 5 m to the side and 1 to 11 m in height (robust standard deviations).
"""

import csv
import math
import pathlib
import random
import sys

import pyarrow.parquet

KEEP_EVERY = 2

# The touchdown target of paper.toml and the course of the runway.
TARGET_DEG = (1.35413542, 103.97961848)
COURSE_DEG = 23.01
# Standard deviations of the offsets.
ACROSS_SD_M = 5.0
HEIGHT_SD_M = 8.0
SEED = 617
# Distances to the target between which the offsets fade.
FADED_M, WHOLE_M = 600.0, 2450.0
METRES_PER_DEG = math.radians(1) * 6_371_009

# Columns of a recording: name there, name in frames.parquet, decimals.
COLUMNS = (
    ("latitude_deg", "latitude_deg", 9),
    ("longitude_deg", "longitude_deg", 9),
    ("altitude_msl_m", "altitude_msl_m", 3),
    ("pitch_deg", "pitch_deg", 3),
    ("roll_deg", "roll_deg", 3),
    ("heading_true_deg", "heading_true_deg", 3),
    ("tas_mps", "true_airspeed_mps", 2),
    ("v_north_mps", "velocity_north_mps", 3),
    ("v_east_mps", "velocity_east_mps", 3),
    ("v_down_mps", "velocity_down_mps", 3),
    ("flap_norm", "flap_ratio", 2),
    ("gear_norm", "gear_ratio", 2),
)


def offsets(number):
    """Offset of a flight to the right of its course and upwards, in metres."""
    draw = random.Random(f"{SEED}/{number}")
    return draw.gauss(0, ACROSS_SD_M), draw.gauss(0, HEIGHT_SD_M)


def move(row, across_m, up_m):
    """Moves a position by the part of its flight's offset that is left at its distance."""
    parallel = METRES_PER_DEG * math.cos(math.radians(TARGET_DEG[0]))
    north_m = (row["latitude_deg"] - TARGET_DEG[0]) * METRES_PER_DEG
    east_m = (row["longitude_deg"] - TARGET_DEG[1]) * parallel
    part = min(max((math.hypot(north_m, east_m) - FADED_M) / (WHOLE_M - FADED_M), 0), 1)
    part *= part * (3 - 2 * part)
    course = math.radians(COURSE_DEG)
    row["latitude_deg"] -= part * across_m * math.sin(course) / METRES_PER_DEG
    row["longitude_deg"] += part * across_m * math.cos(course) / parallel
    row["altitude_msl_m"] += part * up_m


def write(frames, path, number):
    """Writes one flight."""
    rows = pyarrow.parquet.read_table(frames).to_pylist()
    for row in rows:
        move(row, *offsets(number))
    with open(path, "w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(["t_s", *(name for name, _, _ in COLUMNS), "on_ground"])
        for row in [row for row in rows[:-1] if row["tick"] % KEEP_EVERY == 0] + rows[-1:]:
            numbers = (f"{row[column]:.{decimals}f}" for _, column, decimals in COLUMNS)
            lines.writerow([f"{row['time_ns'] / 1e9:g}", *numbers, int(row["on_ground"])])


def main(arguments):
    """Exit code 0 done, 2 bad arguments."""
    folders = [pathlib.Path(argument) / "scenarios" for argument in arguments]
    if len(folders) != 1 or not folders[0].is_dir():
        print(__doc__, file=sys.stderr)
        return 2
    into = pathlib.Path(__file__).resolve().parent
    for number, scenario in enumerate(sorted(folders[0].iterdir()), 1):
        write(scenario / "frames.parquet", into / f"{number:02}.csv", number)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
