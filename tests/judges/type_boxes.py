"""Projects the corners of aircraft meshes with its own WGS-84 and camera code and compares their extremes with boxes_truth.parquet.

Nothing of the project's geometry is used but the corners of the meshes in body axes: calibration.json's matrices and the poses of
frames.parquet, or of aircraft.parquet if there is other traffic, are read with pyarrow. Compared are ticks with the flaps and the gear of
a mesh, and boxes that no edge of the image cuts.

usage: type_boxes.py CORPUS MESHES.json     of {type: [{flap_ratio, gear_ratio, corners_m}, ..]}; prints JSON {TYPE: {boxes, worst_px}};
                                            exit 1 beyond 0.5 px
"""

import json
import pathlib
import sys

import numpy as np
import pyarrow.parquet as pq
from projection import ecef, ecef_from_body

LIMIT_PX = 0.5


def pixels(camera, points):
    rotation = np.array(camera["ecef_from_camera"]["rotation"])
    local = (points - np.array(camera["ecef_from_camera"]["translation_m"])) @ rotation
    pixel = local @ np.array(camera["k"]).T
    return pixel[:, :2] / pixel[:, 2:]


def main(corpus: pathlib.Path, meshes: pathlib.Path) -> int:
    meshes, result = json.loads(meshes.read_text()), {}
    for path in sorted(corpus.glob("scenarios/*/scenario.json")):
        record = json.loads(path.read_text())
        types = [record["aircraft"], *(other["aircraft"] for other in record.get("traffic", []))]
        cameras = json.loads((path.parent / "calibration.json").read_text())["cameras"]
        table = path.parent / ("aircraft.parquet" if len(types) > 1 else "frames.parquet")
        places = {(row["tick"], row.get("aircraft_number", 0)): row for row in pq.read_table(table).to_pylist()}
        for box in pq.read_table(path.parent / "boxes_truth.parquet").to_pylist():
            number = box.get("aircraft_number", 0)
            row = places[box["tick"], number]
            fits = [mesh for mesh in meshes[types[number]] if all(row[name] == mesh[name] for name in ("flap_ratio", "gear_ratio"))]
            if box["truncation"] > 0 or not fits:
                continue
            corners = np.array(fits[0]["corners_m"])
            judged = result.setdefault(types[number], {"boxes": 0, "worst_px": 0.0})
            centre = ecef(row["latitude_deg"], row["longitude_deg"], row["altitude_msl_m"])
            rotation = ecef_from_body(
                row["latitude_deg"], row["longitude_deg"], row["heading_true_deg"], row["pitch_deg"], row["roll_deg"]
            )
            seen = pixels(cameras[box["view"]], centre + corners @ rotation.T)
            middle, size = np.array([box["cx_px"], box["cy_px"]]), np.array([box["width_px"], box["height_px"]])
            off = np.abs(np.concatenate([seen.min(axis=0) - (middle - size / 2), seen.max(axis=0) - (middle + size / 2)]))
            judged["boxes"] += 1
            judged["worst_px"] = max(judged["worst_px"], float(off.max()))
    print(json.dumps(result))
    return 0 if all(one["boxes"] and one["worst_px"] <= LIMIT_PX for one in result.values()) else 1


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])))
