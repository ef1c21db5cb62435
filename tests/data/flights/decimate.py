#!/usr/bin/env python3
"""Regenerates the flight fixtures of this folder from a folder of 30 Hz originals.

    python3 tests/data/flights/decimate.py FOLDER            write every 6th row (5 Hz) of each FOLDER/*.csv beside this script
    python3 tests/data/flights/decimate.py FOLDER --measure  write nothing; print what decimation costs, at several rates

Rows are copied as text, so the values stay those of the originals, digit for digit. The last row of a flight is always kept, so the
end of the flight does not move. The error is the worst distance between an original row and the cubic Hermite interpolation
(positions and velocities) between the kept rows around it, in metres.
"""

import csv
import math
import pathlib
import sys

KEEP_EVERY = 6  # of 30 Hz rows: 5 Hz

SEMI_MAJOR_M = 6_378_137.0
ECCENTRICITY_SQUARED = (2.0 - 1.0 / 298.257223563) / 298.257223563


def kept(count, every):
    """Indices of the rows that decimation keeps."""
    indices = list(range(0, count, every))
    if indices[-1] != count - 1:
        indices.append(count - 1)
    return indices


def local_track(path):
    """Times, positions and velocities (north, east, up; metres about the flight's last row), and the on-ground flags."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    origin = rows[-1]
    latitude = math.radians(float(origin["latitude_deg"]))
    w = 1.0 - ECCENTRICITY_SQUARED * math.sin(latitude) ** 2
    meridian_m = SEMI_MAJOR_M * (1.0 - ECCENTRICITY_SQUARED) / w**1.5
    parallel_m = SEMI_MAJOR_M / w**0.5 * math.cos(latitude)
    track = []
    for row in rows:
        north = math.radians(float(row["latitude_deg"]) - float(origin["latitude_deg"])) * meridian_m
        east = math.radians(float(row["longitude_deg"]) - float(origin["longitude_deg"])) * parallel_m
        position = (north, east, float(row["altitude_msl_m"]))
        velocity = (float(row["v_north_mps"]), float(row["v_east_mps"]), -float(row["v_down_mps"]))
        track.append((float(row["t_s"]), position, velocity, row["on_ground"] == "1"))
    return track


def hermite(before, after, time_s):
    """Position at `time_s` on the cubic that has the positions and velocities of both rows."""
    span = after[0] - before[0]
    s = (time_s - before[0]) / span
    weights = (
        (1.0 + 2.0 * s) * (1.0 - s) ** 2,
        s * (1.0 - s) ** 2 * span,
        s * s * (3.0 - 2.0 * s),
        s * s * (s - 1.0) * span,
    )
    return [
        weights[0] * before[1][axis] + weights[1] * before[2][axis]
        + weights[2] * after[1][axis] + weights[3] * after[2][axis]
        for axis in range(3)
    ]


def worst_error_m(track, every):
    """Worst interpolation error in the air and with a wheel on the ground (or touching down within the interval), metres."""
    airborne = ground = 0.0
    indices = kept(len(track), every)
    for first, last in zip(indices, indices[1:]):
        touching = any(row[3] for row in track[first : last + 1])
        for row in track[first + 1 : last]:
            error = math.dist(row[1], hermite(track[first], track[last], row[0]))
            if touching:
                ground = max(ground, error)
            else:
                airborne = max(airborne, error)
    return airborne, ground


def measure(originals):
    """Prints a Markdown table: worst error per flight and rate."""
    rates = {10: 3, 5: 6, 2: 15, 1: 30}
    print("| flight | " + " | ".join(f"{rate} Hz" for rate in rates) + " |")
    print("|---|" + "---|" * len(rates))
    for path in originals:
        track = local_track(path)
        cells = ["{:.3f} / {:.3f}".format(*worst_error_m(track, every)) for every in rates.values()]
        print(f"| {path.stem} | " + " | ".join(cells) + " |")


def decimate(path, into):
    """Writes the kept rows of `path` to a file of the same name in the folder `into`."""
    header, *rows = path.read_text().splitlines()
    lines = [header] + [rows[index] for index in kept(len(rows), KEEP_EVERY)]
    (into / path.name).write_text("\n".join(lines) + "\n")


def main(arguments):
    """Exit code 0 done, 2 bad arguments."""
    options = [argument for argument in arguments if argument.startswith("--")]
    folders = [argument for argument in arguments if not argument.startswith("--")]
    if len(folders) != 1 or options not in ([], ["--measure"]):
        print(__doc__, file=sys.stderr)
        return 2
    into = pathlib.Path(__file__).resolve().parent
    originals = sorted(pathlib.Path(folders[0]).glob("*.csv"))
    if not originals or pathlib.Path(folders[0]).resolve() == into:
        print(f"{folders[0]}: expected a folder of 30 Hz originals (*.csv), other than {into}", file=sys.stderr)
        return 2
    if options:
        measure(originals)
    else:
        for path in originals:
            decimate(path, into)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
