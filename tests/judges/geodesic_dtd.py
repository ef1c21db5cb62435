"""Compares every dtd_m of a labelled corpus with GeographicLib's own geodesic (Karney's Python code).

usage: geodesic_dtd.py CORPUS        prints JSON {rows, scenarios, worst_m}; exit 1 if a row differs by more than a millimetre
"""

import json
import pathlib
import sys

import pyarrow.parquet as pq
from geographiclib.geodesic import Geodesic

TOLERANCE_M = 1e-3


def main(corpus: pathlib.Path) -> int:
    rows, scenarios, worst = 0, 0, 0.0
    for record_path in sorted(corpus.glob("scenarios/*/scenario.json")):
        target = json.loads(record_path.read_text())["touchdown"]
        table = pq.read_table(record_path.parent / "frames.parquet").to_pydict()
        for latitude, longitude, dtd in zip(table["latitude_deg"], table["longitude_deg"], table["dtd_m"]):
            truth = Geodesic.WGS84.Inverse(latitude, longitude, target["latitude_deg"], target["longitude_deg"])
            worst = max(worst, abs(truth["s12"] - dtd))
            rows += 1
        scenarios += 1
    print(json.dumps({"rows": rows, "scenarios": scenarios, "worst_m": worst}))
    return 0 if rows and worst <= TOLERANCE_M else 1


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1])))
