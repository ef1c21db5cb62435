"""Projects the aircraft's centre of gravity, wing tips and nose with its own WGS-84 and camera code and compares with boxes_truth.parquet.

Nothing of the project's geometry is used: only calibration.json's matrices and frames.parquet's poses, read with pyarrow. The wing
tips are half a span (17.9 m) left and right of the body's plane of symmetry, so the box must reach from one to the other: its width
is compared with the projected distance of two points a span apart, seen from ahead.

usage: projection.py CORPUS     prints JSON {boxes, outside, worst_width_ratio}; exit 1 if a box does not contain the aircraft
"""

import json
import pathlib
import sys

import numpy as np
import pyarrow.parquet as pq

A, F = 6378137.0, 1 / 298.257223563
E2 = F * (2 - F)
SPAN_M = 35.8


def ecef(latitude_deg, longitude_deg, height_m):
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    n = A / np.sqrt(1 - E2 * np.sin(lat) ** 2)
    return np.array(
        [
            (n + height_m) * np.cos(lat) * np.cos(lon),
            (n + height_m) * np.cos(lat) * np.sin(lon),
            (n * (1 - E2) + height_m) * np.sin(lat),
        ]
    )


def ecef_from_body(latitude_deg, longitude_deg, heading_deg, pitch_deg, roll_deg):
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    h, p, r = np.radians([heading_deg, pitch_deg, roll_deg])
    north = np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    down = np.cross(north, east)
    yaw = np.array([[np.cos(h), -np.sin(h), 0], [np.sin(h), np.cos(h), 0], [0, 0, 1]])
    pitch = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    roll = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
    return np.stack([north, east, down], axis=1) @ yaw @ pitch @ roll


def project(camera, point):
    rotation = np.array(camera["ecef_from_camera"]["rotation"])
    local = rotation.T @ (point - np.array(camera["ecef_from_camera"]["translation_m"]))
    pixel = np.array(camera["k"]) @ local
    return pixel[:2] / pixel[2]


def main(corpus: pathlib.Path) -> int:
    boxes, outside, worst_ratio = 0, 0, 1.0
    for folder in sorted(path.parent for path in corpus.glob("scenarios/*/scenario.json")):
        cameras = json.loads((folder / "calibration.json").read_text())["cameras"]
        frames = {row["tick"]: row for row in pq.read_table(folder / "frames.parquet").to_pylist()}
        for box in pq.read_table(folder / "boxes_truth.parquet").to_pylist():
            if box["truncation"] > 0:
                continue
            row, camera = frames[box["tick"]], cameras[box["view"]]
            centre = ecef(row["latitude_deg"], row["longitude_deg"], row["altitude_msl_m"])
            rotation = ecef_from_body(
                row["latitude_deg"], row["longitude_deg"], row["heading_true_deg"], row["pitch_deg"], row["roll_deg"]
            )
            pixel = project(camera, centre)
            left, right = (project(camera, centre + rotation @ np.array([0, side * SPAN_M / 2, 0])) for side in (-1, 1))
            boxes += 1
            inside = (
                abs(pixel[0] - box["cx_px"]) <= box["width_px"] / 2 and abs(pixel[1] - box["cy_px"]) <= box["height_px"] / 2
            )
            outside += not inside
            ratio = box["width_px"] / abs(right[0] - left[0])
            worst_ratio = max(worst_ratio, ratio, 1 / ratio)
    print(json.dumps({"boxes": boxes, "outside": outside, "worst_width_ratio": round(worst_ratio, 4)}))
    # Up to 25 degrees off the nose, fuselage and sweep make the box at most a quarter wider than the span itself.
    return 0 if boxes and not outside and worst_ratio < 1.25 else 1


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1])))
