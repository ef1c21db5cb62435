#!/usr/bin/env python3
"""Writes the flights of a corpus as recordings (CSV) beside this script.

    python3 tests/data/paper-flights/recordings.py CORPUS

Every second tick is kept, and the last one: the pictures are not used, and the simulator interpolates between rows.
"""

import csv
import pathlib
import sys

import pyarrow.parquet

KEEP_EVERY = 2

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


def write(frames, path):
    """Writes one flight."""
    rows = pyarrow.parquet.read_table(frames).to_pylist()
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
        write(scenario / "frames.parquet", into / f"{number:02}.csv")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
