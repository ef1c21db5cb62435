"""Projects the corners of aircraft meshes with its own WGS-84 and camera code and compares their extremes with boxes_truth.parquet.

Nothing of the project's geometry is used but the corners of the meshes in body axes: calibration.json's matrices and frames.parquet's
poses are read with pyarrow. Compared are ticks with the flaps and the gear of the meshes, and boxes that no edge of the image cuts.

usage: type_boxes.py CORPUS MESHES.json     of {type: {flap_ratio, gear_ratio, corners_m}}; prints JSON {TYPE: {boxes, worst_px}}; exit 1
                                            beyond 0.5 px
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
        aircraft = json.loads(path.read_text())["aircraft"]
        mesh = meshes[aircraft]
        corners = np.array(mesh["corners_m"])
        cameras = json.loads((path.parent / "calibration.json").read_text())["cameras"]
        frames = {row["tick"]: row for row in pq.read_table(path.parent / "frames.parquet").to_pylist()}
        judged = result.setdefault(aircraft, {"boxes": 0, "worst_px": 0.0})
        for box in pq.read_table(path.parent / "boxes_truth.parquet").to_pylist():
            row = frames[box["tick"]]
            if box["truncation"] > 0 or any(row[name] != mesh[name] for name in ("flap_ratio", "gear_ratio")):
                continue
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
