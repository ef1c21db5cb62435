#!/usr/bin/env python3
"""Cuts descent.csv from the recorded flight of the Python package traffic 2.13: the descent below 10,000 ft.

    python3 tests/data/a320-descent/make.py traffic/data/samples/performance/fuelflow_a320.json.gz
"""

import csv
import gzip
import json
import pathlib
import sys

COLUMNS = ["altitude", "groundspeed", "track", "CAS", "pitch", "roll"]
NAMES = ["altitude_ft", "ground_speed_kt", "track_deg", "cas_kt", "pitch_deg", "roll_deg"]

with gzip.open(sys.argv[1]) as file:
    flight = json.load(file)
keys = sorted(flight["timestamp"], key=int)
above = [place for place, key in enumerate(keys) if flight["altitude"][key] > 10_000]
descent = keys[above[-1] :]
out = pathlib.Path(__file__).parent / "descent.csv"
with out.open("w", newline="") as file:
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["t_s", *NAMES])
    for second, key in enumerate(descent):
        writer.writerow([second, *(f"{flight[column][key]:.6g}" for column in COLUMNS)])
