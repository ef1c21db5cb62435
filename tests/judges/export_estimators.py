"""Judges exported estimators: from the boxes and registrations of a corpus, ONNX Runtime answers what predictions.parquet of the run holds.

Usage: export_estimators.py CORPUS RUN MODELS. Prints JSON: by estimator the rows, those with an answer, and the largest relative difference.
"""

import glob
import json
import sys
from pathlib import Path

import numpy as np
import onnxruntime
import pyarrow.parquet as pq

NEAREST_M, EDGE_PX = 1852.0, 1.5


def seen_in(folder, sizes):
    """Confirmed boxes of a scenario by tick and view, without those at the edge of the image."""
    boxes = {}
    rows = pq.read_table(glob.glob(f"{folder}/detections/*.parquet")[0]).to_pylist()
    confirmed = [row for row in rows if row["cx_px"] is not None and row["confirmed"] is not False]
    # Of several, the one with the highest score counts: it comes last.
    for row in sorted(confirmed, key=lambda row: row["score"]):
        box = np.array([row[key] for key in ("cx_px", "cy_px", "width_px", "height_px")])
        low, high = box[:2] - box[2:] / 2, box[:2] + box[2:] / 2
        if (low > EDGE_PX).all() and (high < np.array(sizes[row["view"]]) - 1 - EDGE_PX).all():
            boxes[row["tick"], row["view"]] = box
    return boxes


def registrations_in(folder, boxes):
    """Registrations by tick and view, of the objects in the boxes."""
    registrations = {}
    for path in glob.glob(f"{folder}/registrations/*.parquet"):
        for row in pq.read_table(path).to_pylist():
            tick, view, reference = row["tick"], row["view"], row["reference"]
            if row["dx_px"] is None or (tick, view) not in boxes or (tick, reference) not in boxes:
                continue
            point, shift = (np.array([row[k] for k in keys]) for keys in (("x_px", "y_px"), ("dx_px", "dy_px")))
            pairs = ((boxes[tick, reference], point), (boxes[tick, view], point + shift))
            if all((np.abs(at - box[:2]) <= box[2:] / 2).all() for box, at in pairs):
                registrations[tick, view] = shift
                registrations[tick, reference] = np.zeros(2)
    return registrations


def main():
    corpus, run, models = map(Path, sys.argv[1:])
    cameras = json.loads((run / "run.json").read_text())["cameras"]
    sizes = {view: (camera["width_px"], camera["height_px"]) for view, camera in cameras.items()}
    views = json.loads((run / "normalisation.json").read_text())["views"]
    rows = pq.read_table(run / "predictions.parquet").to_pylist()
    found = {}
    for scenario in {row["scenario"] for row in rows}:
        boxes = seen_in(corpus / "scenarios" / scenario, sizes)
        found[scenario] = boxes, registrations_in(corpus / "scenarios" / scenario, boxes)

    def gathered(which, length):
        missing = np.full(length, np.nan)
        return np.array(
            [[found[row["scenario"]][which].get((row["tick"], view), missing) for view in views] for row in rows]
        )

    inputs = {"boxes": gathered(0, 4), "registrations": gathered(1, 2)}
    views_seen = (~np.isnan(inputs["boxes"][:, :, 0])).sum(axis=1)
    verdict = {}
    for path in sorted(models.glob("*.onnx")):
        model = onnxruntime.InferenceSession(path)
        taken = {known.name: inputs[known.name] for known in model.get_inputs()}
        ours = model.run(["distance_m"], taken)[0]
        stored = [row[f"{path.stem}_dtd_m"] for row in rows]
        theirs = np.array([np.nan if value is None else value for value in stored])
        answered = ~np.isnan(theirs)
        assert not np.isnan(ours[answered]).any(), path.stem
        # A run gives no answer where one view alone saw what may not be the aircraft; a model sees single ticks.
        withheld = ~answered & ~np.isnan(ours)
        assert (views_seen[withheld] == 1).all() and withheld.sum() <= 0.02 * len(rows), path.stem
        apart = np.abs(ours - theirs)[answered] / np.maximum(np.abs(theirs[answered]), NEAREST_M)
        verdict[path.stem] = {
            "rows": len(rows),
            "answered": int(answered.sum()),
            "apart": float(apart.max()),
            "inputs": sorted(taken),
        }
    print(json.dumps(verdict))


main()
