"""Projects the corners of aircraft meshes with its own WGS-84 and camera code and compares their extremes with boxes_truth.parquet, and what
nearer silhouettes cover of farther ones with its `occluded_fraction`.

Nothing of the project's geometry is used but the corners of the meshes in body axes, and which three of them are a triangle:
calibration.json's matrices and the poses of frames.parquet, or of aircraft.parquet if there is other traffic, are read with pyarrow.
Compared are ticks with the flaps and the gear of a mesh, and boxes that no edge of the image cuts.

usage: type_boxes.py CORPUS MESHES.json     of {type: [{flap_ratio, gear_ratio, corners_m, triangles}, ..]}; prints JSON
                                            {TYPE: {boxes, worst_px, partly_hidden, worst_hidden}}; exit 1 beyond 0.5 px or 0.01
"""

import json
import pathlib
import sys

import numpy as np
import pyarrow.parquet as pq
from projection import ecef, ecef_from_body

LIMIT_PX = 0.5
LIMIT_HIDDEN = 0.01
# Samples along the longer side of a box.
SAMPLES = 600
# Of boxes with less or more of their aircraft hidden, a wrong silhouette may not be noticed.
PARTLY = (0.02, 0.98)


def pixels(camera, points):
    rotation = np.array(camera["ecef_from_camera"]["rotation"])
    local = (points - np.array(camera["ecef_from_camera"]["translation_m"])) @ rotation
    pixel = local @ np.array(camera["k"]).T
    return pixel[:, :2] / pixel[:, 2:]


def silhouette(aircraft, columns, rows):
    """The points of a grid that are in a triangle of an aircraft."""
    inside = np.zeros((len(rows), len(columns)), bool)
    for corners in aircraft["seen"][aircraft["triangles"]]:
        low, high = corners.min(axis=0), corners.max(axis=0)
        across, down = (slice(*np.searchsorted(at, [low[axis], high[axis]])) for axis, at in enumerate((columns, rows)))
        x, y = columns[across], rows[down, None]
        if x.size and y.size:
            pairs = zip(corners, np.roll(corners, -1, axis=0))
            sides = np.array([(q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) for p, q in pairs])
            inside[down, across] |= (sides >= 0).all(axis=0) | (sides <= 0).all(axis=0)
    return inside


def hidden(aircraft, nearer):
    """Part of an aircraft's silhouette that nearer ones cover."""
    low, high = aircraft["seen"].min(axis=0), aircraft["seen"].max(axis=0)
    columns, rows = (np.arange(low[axis], high[axis], (high - low).max() / SAMPLES) for axis in range(2))
    own = silhouette(aircraft, columns, rows)
    covered = np.zeros_like(own)
    for other in nearer:
        covered |= silhouette(other, columns, rows)
    return (own & covered).sum() / own.sum()


def projected(row, meshes, camera):
    """An aircraft in an image; None without a mesh of its flaps and gear."""
    fits = [mesh for mesh in meshes if all(row[name] == mesh[name] for name in ("flap_ratio", "gear_ratio"))]
    if not fits:
        return None
    centre = ecef(row["latitude_deg"], row["longitude_deg"], row["altitude_msl_m"])
    rotation = ecef_from_body(*(row[f"{name}_deg"] for name in ("latitude", "longitude", "heading_true", "pitch", "roll")))
    seen = pixels(camera, centre + np.array(fits[0]["corners_m"]) @ rotation.T)
    away_m = np.linalg.norm(centre - np.array(camera["ecef_from_camera"]["translation_m"]))
    return {"seen": seen, "triangles": np.array(fits[0]["triangles"]), "away_m": away_m}


def main(corpus: pathlib.Path, meshes: pathlib.Path) -> int:
    meshes, result = json.loads(meshes.read_text()), {}
    for path in sorted(corpus.glob("scenarios/*/scenario.json")):
        record = json.loads(path.read_text())
        types = [record["aircraft"], *(other["aircraft"] for other in record.get("traffic", []))]
        cameras = json.loads((path.parent / "calibration.json").read_text())["cameras"]
        table = path.parent / ("aircraft.parquet" if len(types) > 1 else "frames.parquet")
        places = {(row["tick"], row.get("aircraft_number", 0)): row for row in pq.read_table(table).to_pylist()}
        images = {}
        for box in pq.read_table(path.parent / "boxes_truth.parquet").to_pylist():
            number = box.get("aircraft_number", 0)
            seen = projected(places[box["tick"], number], meshes[types[number]], cameras[box["view"]])
            images.setdefault((box["tick"], box["view"]), []).append((box, types[number], seen))
        for (box, aircraft, seen), here in ((one, here) for here in images.values() for one in here):
            if box["truncation"] > 0 or seen is None:
                continue
            judged = result.setdefault(aircraft, {"boxes": 0, "worst_px": 0.0, "partly_hidden": 0, "worst_hidden": 0.0})
            middle, size = np.array([box["cx_px"], box["cy_px"]]), np.array([box["width_px"], box["height_px"]])
            corners = seen["seen"]
            off = np.abs(np.concatenate([corners.min(axis=0) - (middle - size / 2), corners.max(axis=0) - (middle + size / 2)]))
            judged["boxes"] += 1
            judged["worst_px"] = max(judged["worst_px"], float(off.max()))
            others = [other for _, _, other in here]
            if len(others) == 1 or None in others or box["visible_fraction"] < 1:
                continue
            part = hidden(seen, [other for other in others if other["away_m"] < seen["away_m"]])
            judged["partly_hidden"] += bool(PARTLY[0] < part < PARTLY[1])
            judged["worst_hidden"] = max(judged["worst_hidden"], float(abs(part - box["occluded_fraction"])))
    print(json.dumps(result))
    right = [one["boxes"] and one["worst_px"] <= LIMIT_PX and one["worst_hidden"] <= LIMIT_HIDDEN for one in result.values()]
    return 0 if all(right) else 1


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])))
