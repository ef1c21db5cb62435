"""Peak memory of `dtd plan` with one recorded flight, and of `dtd tracks import`, by the size of the CSV.

usage: long_csv.py DTD FOLDER [GB ...]    prints JSON; sizes 0.1 and 2 by default. FOLDER needs room for the largest size. The recording is
parked until the arrival of tests/data/flights/01_calm_ils.csv; the tracks are that arrival as `traffic` writes it, behind aircraft over
Europe. Exit 1 if the largest needs more than 50 MB above the smallest.
"""

import csv
import json
import math
import os
import pathlib
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parents[2]
FLIGHT = HERE / "tests/data/flights/01_calm_ils.csv"
MOST_MB = 50
KNOTS_PER_MPS = 3600 / 1852
SWEEP = """
[corpus]
name = "long"
seed = 1
[approach]
airport = "WSSS"
runway = "02L"
aircraft = "B737-800"
rig = "wide-baseline"
[grid]
times = ["12:00"]
repeats = 1
day_of_year = 80
[picture]
width_px = 960
height_px = 640
frame_rate = 1
[[recorded]]
files = "recording.csv"
[weather.clear]
visibility_m = 40000
"""


def fill(file, row, size):
    """Rows by their number, many at a time, until the file has that size."""
    number = 0
    while file.tell() < size:
        file.write("".join(row(number + index) for index in range(100_000)))
        number += 100_000


def repeat(file, rows, size):
    """The same rows until the file has that size."""
    text = "".join(rows)
    while file.tell() < size:
        file.write(text)


def recording(path, size):
    header, *rows = FLIGHT.read_text().splitlines()
    parked = rows[-1].split(",", 1)[1]
    with path.open("w") as file:
        file.write(f"{header}\n")
        fill(file, lambda number: f"{number * 0.02 - 4e6:.2f},{parked}\n", size)
        file.write("\n".join(rows) + "\n")


def tracks(path, size):
    with FLIGHT.open() as file:
        flight = list(csv.DictReader(file))
    with path.open("w") as file:
        file.write("timestamp,icao24,latitude,longitude,altitude,groundspeed,track,onground\n")
        rows = (
            f"{1.6e9 + number / 4000:.1f},{4200000 + number % 4000:x},{44 + number % 997 / 100:.5f},"
            f"{number % 1999 / 100:.5f},{35000 + number % 40 * 25},450,{number % 360},False\n"
            for number in range(200_000)
        )
        repeat(file, rows, size)
        for state in flight:
            value = {key: float(text) for key, text in state.items() if key != "on_ground"}
            north, east = value["v_north_mps"], value["v_east_mps"]
            file.write(
                f"{1.7e9 + value['t_s']:.3f},abc123,{value['latitude_deg']},{value['longitude_deg']},"
                f"{round(value['altitude_msl_m'] / 0.3048 / 25) * 25},{math.hypot(north, east) * KNOTS_PER_MPS:.0f},"
                f"{math.degrees(math.atan2(east, north)) % 360:.2f},{state['on_ground'] in ('1', 'True', 'true')}\n"
            )


def peak(command):
    """Peak of the resident memory, MB, and seconds."""
    began = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    errors = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    code = os.waitstatus_to_exitcode(status)
    if code not in (0, 3):
        sys.exit(f"{' '.join(map(str, command))}: exit {code}: {errors[-500:]}")
    return {"peak_mb": round(usage.ru_maxrss / 1024, 1), "seconds": round(time.monotonic() - began, 1)}


def main():
    dtd, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    sizes = sorted(map(float, sys.argv[3:])) or [0.1, 2.0]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "sweep.toml").write_text(SWEEP)
    found = {"plan": {}, "tracks import": {}}
    for gigabytes in sizes:
        size = int(gigabytes * 1e9)
        path = folder / "recording.csv"
        recording(path, size)
        found["plan"][f"{gigabytes} GB"] = peak([dtd, "plan", folder / "sweep.toml"])
        path.unlink()
        path = folder / "traffic.csv"
        tracks(path, size)
        out = folder / f"flights-{gigabytes}"
        command = [dtd, "tracks", "import", path, "--runway", "WSSS/02L", "--out", out]
        found["tracks import"][f"{gigabytes} GB"] = peak(command)
        path.unlink()
        if not list(out.glob("*.csv")):
            sys.exit(f"{' '.join(map(str, command))}: no recording of the arrival")
    print(json.dumps(found, indent=1))
    grown = [list(rows.values())[-1]["peak_mb"] - list(rows.values())[0]["peak_mb"] for rows in found.values()]
    return 1 if max(grown) > MOST_MB else 0


if __name__ == "__main__":
    sys.exit(main())
