"""Judges the estimator inverse_range of a run: the formulas of baselines.json solve their least-squares problem as SciPy solves it, and
predictions.parquet holds what they give.

Usage: inverse_range.py CORPUS RUN. The corpus must have no false boxes. Prints JSON.
"""

import glob
import json
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from scipy.optimize import least_squares

HUBER, RIDGE, FLOOR_SD_PX, NEAREST_M, NM = 1.345, 1e-7, 0.05, 926.0, 1852.0


def ticks(corpus, views):
    """One dictionary per labelled tick before touchdown."""
    splits = json.loads((corpus / "splits.json").read_text())["scenarios"]
    for folder in sorted((corpus / "scenarios").iterdir()):
        frames = pq.read_table(folder / "frames.parquet").to_pylist()
        boxes, shifts = {}, {}
        for row in pq.read_table(glob.glob(f"{folder}/detections/*.parquet")[0]).to_pylist():
            if row["cx_px"] is not None:
                boxes[row["tick"], row["view"]] = (row["cx_px"], row["cy_px"])
        for path in glob.glob(f"{folder}/registrations/*.parquet"):
            for row in pq.read_table(path).to_pylist():
                if row["dx_px"] is not None:
                    shifts[row["tick"], row["view"]] = row
        for frame in frames:
            if frame["along_track_m"] > 0:
                tick = frame["tick"]
                yield {
                    "side": splits[folder.name]["side"],
                    "key": (folder.name, tick),
                    "dtd_m": frame["dtd_m"],
                    "boxes": [boxes.get((tick, view)) for view in views],
                    "shifts": [shifts.get((tick, view)) for view in views],
                }


def places(tick, fit, views):
    """Coordinates for a fit and the standard deviation of their differences; None without them."""
    boxes = [tick["boxes"][view] for view in fit["views"]]
    if None in boxes:
        return None
    if not fit["registered"]:
        return np.ravel(boxes), 0.0
    shifts = [tick["shifts"][view] for view in fit["views"]]
    found = [shift for shift in shifts if shift]
    names = [views[view] for view in fit["views"]]
    if len(found) != len(names) - 1 or found[0]["reference"] not in names:
        return None
    by = np.array([(s["dx_px"], s["dy_px"]) if s else (0.0, 0.0) for s in shifts])
    variance = np.mean([(s["sd_x_px"] ** 2 + s["sd_y_px"] ** 2) / 2 for s in found])
    return np.ravel(np.mean(np.array(boxes) - by, axis=0) + by), np.sqrt(variance)


def terms(coordinates, fit):
    u = (coordinates - np.array(fit["offset_px"])) / np.array(fit["scale_px"])
    n = u.shape[1]
    products = [u[:, i] * u[:, j] for i in range(n) for j in range(i, n)]
    return np.column_stack([np.ones(len(u)), u, *products])


def huber(z, count):
    """Huber's loss of squares and its derivatives for the first `count`; the squares themselves for the ridge after them."""
    far = np.where(np.arange(len(z)) < count, np.maximum(z, 1.0), 1.0)
    value = np.where(far > 1.0, 2.0 * np.sqrt(far) - 1.0, z)
    return np.stack([value, far**-0.5, np.where(far > 1.0, -0.5 * far**-1.5, 0.0)])


def judge(fit, training, views):
    """Largest relative difference between our distances on the training side and SciPy's."""
    rows = [(tick["dtd_m"], *found) for tick in training if (found := places(tick, fit, views))]
    d = np.array([row[0] for row in rows])
    x = terms(np.array([row[1] for row in rows]), fit)
    precision = 1 / np.sqrt(1 + (np.array([row[2] for row in rows]) / FLOOR_SD_PX) ** 2)
    s = fit["setback_m"]
    w = precision * (d + s) ** 2 / np.maximum(d, NEAREST_M)
    ridge = RIDGE * np.mean(np.sum((w[:, None] * x) ** 2, axis=0))
    ours = np.array(fit["coefficients_per_m"])
    freedom = np.sqrt(len(d) / (len(d) - x.shape[1]))
    deviation = fit["deviation"] / freedom
    a = np.vstack([w[:, None] * x, np.sqrt(ridge) * np.eye(x.shape[1])])
    b = np.concatenate([w / (d + s), np.zeros(x.shape[1])])
    # In coordinates in which all directions are alike, or SciPy stops on its way along a long valley.
    q, r = np.linalg.qr(a)
    solved = least_squares(
        lambda z: q @ z - b,
        q.T @ b,
        jac=lambda z: q,
        loss=lambda z: huber(z, len(d)),
        f_scale=HUBER * deviation,
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
        max_nfev=10_000,
    )
    theirs = np.linalg.solve(r, solved.x)
    apart = np.abs((1 / (x @ ours) - s) - (1 / (x @ theirs) - s)) / d
    residuals = np.abs(w * (x @ theirs - 1 / (d + s)))
    return {
        "views": fit["views"],
        "registered": fit["registered"],
        "ticks": len(d),
        "apart": float(apart.max()),
        "deviation_apart": float(abs(1.4826 * np.sort(residuals)[len(d) // 2] / deviation - 1)),
    }


def main():
    corpus, run = map(Path, sys.argv[1:])
    baselines = json.loads((run / "baselines.json").read_text())
    config = json.loads((run / "config.json").read_text())
    views, fits = baselines["views"], baselines["inverse_range"]["fits"]
    dropped = json.loads((run / "run.json").read_text())["dropped_training_boxes"]
    assert all(view["dropped"] == 0 for view in dropped.values())
    farthest = config["max_dtd_nm"] or np.inf
    all_ticks = list(ticks(corpus, views))
    training = [
        tick
        for tick in all_ticks
        if tick["side"] == "train" and config["min_dtd_nm"] * NM <= tick["dtd_m"] <= farthest * NM
    ]
    by_key = {tick["key"]: tick for tick in all_ticks}
    compared, worst = 0, 0.0
    for row in pq.read_table(run / "predictions.parquet").to_pylist():
        if row["inverse_range_dtd_m"] is None:
            # One view alone saw something that may not be the aircraft.
            continue
        tick = by_key[row["scenario"], row["tick"]]
        for fit in fits:
            if found := places(tick, fit, views):
                x = terms(found[0][None, :], fit)
                distance = 1 / (x @ np.array(fit["coefficients_per_m"]))[0] - fit["setback_m"]
                worst = max(worst, abs(row["inverse_range_dtd_m"] / distance - 1))
                compared += 1
                break
    fits = [judge(fit, training, views) for fit in fits]
    judged = {"fits": fits, "predictions": compared, "predictions_apart": worst}
    print(json.dumps(judged))


main()
