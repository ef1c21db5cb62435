"""Imports every runway in a folder of published tables with `dtd airport import --accept` and compares them with what is independent.

usage: runways.py DTD FOLDER    prints JSON. FOLDER has apt.dat, earth_nav.dat, ourairports-runways.csv, lard-runway-corners.json (the
corners of the pavement by LARD). Exit 1 if no runway has corners, or if one that is off the corners by 5 m across or 0.02 degrees is
neither a conflict nor unconfirmed.
"""

import csv
import json
import math
import pathlib
import subprocess
import sys

from geographiclib.geodesic import Geodesic

ACROSS_M = 5.0
COURSE_DEG = 0.02
EARTH = Geodesic.WGS84


def line(near, far):
    """Course from one place (latitude, longitude) to another, degrees."""
    return EARTH.Inverse(*near, *far)["azi1"] % 360


def turned(course_deg, reference_deg):
    """Difference of two courses, degrees."""
    return (course_deg - reference_deg + 180) % 360 - 180


def middle(one, other):
    """The place half way between two corners."""
    return tuple((one["coordinate"][key] + other["coordinate"][key]) / 2 for key in ("latitude", "longitude"))


def against_corners(runway, corners):
    """Offsets of a runway from the middles of its pavement's ends."""
    threshold = (runway["threshold"]["latitude_deg"], runway["threshold"]["longitude_deg"])
    ends = sorted(
        (middle(corners["A"], corners["B"]), middle(corners["C"], corners["D"])),
        key=lambda end: EARTH.Inverse(*threshold, *end)["s12"],
    )
    course_deg = line(*ends)
    offset = EARTH.Inverse(*ends[0], *threshold)
    angle = math.radians(offset["azi1"] - course_deg)
    return {
        "across_m": round(offset["s12"] * math.sin(angle), 1),
        "past_the_end_m": round(offset["s12"] * math.cos(angle), 1),
        "turned_deg": round(turned(runway["course_true_deg"], course_deg), 4),
    }


def is_off(across_m, turned_deg):
    return abs(across_m) > ACROSS_M or abs(turned_deg) > COURSE_DEG


def main():
    dtd, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    tables = [str(folder / name) for name in ("apt.dat", "earth_nav.dat", "ourairports-runways.csv")]
    corners = json.loads((folder / "lard-runway-corners.json").read_text())
    with open(folder / "ourairports-runways.csv", newline="") as file:
        ends = [(row["airport_ident"], row[end]) for row in csv.DictReader(file) for end in ("le_ident", "he_ident")]
    found = {}
    for airport, name in ends:
        command = [dtd, "airport", "import", airport, name, "--accept", "--json", "--from", *tables]
        made = subprocess.run(command, capture_output=True, text=True)
        if made.returncode != 0:
            found[f"{airport}/{name}"] = {"refused": made.stderr.strip().splitlines()[-1]}
            continue
        imported = json.loads(made.stdout)
        result = {
            "course_true_deg": imported["runway"]["course_true_deg"],
            "conflicts": [conflict["figure"] for conflict in imported["conflicts"]],
            "confirmed_by": imported["confirmed_by"],
            "course_magnetic_deg": imported["runway"]["course_magnetic_deg"],
        }
        if name in corners.get(airport, {}):
            result["corners"] = against_corners(imported["runway"], corners[airport][name])
        found[f"{airport}/{name}"] = result
    judged = {name: result["corners"] for name, result in found.items() if "corners" in result}
    off = [name for name, corners in judged.items() if is_off(corners["across_m"], corners["turned_deg"])]
    names = {"threshold", "course_true_deg"}
    unnamed = [
        name
        for name in off
        if found[name]["confirmed_by"] and not names & set(found[name]["conflicts"])
    ]
    imported = [name for name, result in found.items() if "refused" not in result]
    print(
        json.dumps(
            {
                "runways": len(ends),
                "imported": len(imported),
                "airports_imported": len({name.split("/")[0] for name in imported}),
                "with_conflicts": sum(bool(found[name]["conflicts"]) for name in imported),
                "with_corners": len(judged),
                "unconfirmed": sum(not found[name]["confirmed_by"] for name in imported),
                "neither_confirmed_nor_conflict": [
                    name for name in imported if not (found[name]["confirmed_by"] or found[name]["conflicts"])
                ],
                "off_the_corners": off,
                "not_named": unnamed,
                "by_runway": found,
            },
            indent=1,
        )
    )
    return 1 if unnamed or not judged else 0


if __name__ == "__main__":
    sys.exit(main())
