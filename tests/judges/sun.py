"""Compares the sun of plans with astral's almanac, and their local time with the system's time zones.

usage: sun.py PLAN.json..    (of `dtd plan --json`) prints JSON {rows, airports, worst_deg}; exit 1 if a direction differs by 0.1 degrees
"""

import datetime
import json
import math
import pathlib
import sys
import zoneinfo

import astral
import astral.sun

TOLERANCE_DEG = 0.1
# The year of the simulator's clock.
YEAR = 2023
ZONES = {
    "BIKF": "Atlantic/Reykjavik",
    "EGLL": "Europe/London",
    "FIMP": "Indian/Mauritius",
    "HAAB": "Africa/Addis_Ababa",
    "KLAX": "America/Los_Angeles",
    "LSZH": "Europe/Zurich",
    "SBGR": "America/Sao_Paulo",
    "SKBO": "America/Bogota",
    "WSSS": "Asia/Singapore",
}


def main(paths: list[pathlib.Path]) -> int:
    rows, airports, worst = 0, set(), 0.0
    for path in paths:
        plan = json.loads(path.read_text())
        day = int(path.stem.rsplit("-", 1)[1])
        place = plan["runway"]["threshold"]
        zone = zoneinfo.ZoneInfo(ZONES[plan["runway"]["airport"]])
        observer = astral.Observer(place["latitude_deg"], place["longitude_deg"], 0)
        for scenario in plan["scenarios"]:
            hour, minute = map(int, scenario["time_of_day"].split(":"))
            date = datetime.date(YEAR, 1, 1) + datetime.timedelta(days=day - 1)
            local = datetime.datetime.combine(date, datetime.time(hour, minute), zone)
            up = astral.sun.elevation(observer, local, with_refraction=False)
            turn = (astral.sun.azimuth(observer, local) - scenario["sun_azimuth_deg"] + 180) % 360 - 180
            aside = turn * math.cos(math.radians(up))
            worst = max(worst, math.hypot(up - scenario["sun_elevation_deg"], aside))
            rows += 1
        airports.add(plan["runway"]["airport"])
    print(json.dumps({"rows": rows, "airports": len(airports), "worst_deg": worst}))
    return 0 if rows and worst < TOLERANCE_DEG else 1


if __name__ == "__main__":
    sys.exit(main([pathlib.Path(path) for path in sys.argv[1:]]))
