"""Compares ONNX Runtime's output with that of the code which trains the detector; see compare_onnx.rs."""

import json
import sys
import time
from pathlib import Path

import numpy as np
import onnxruntime

folder = Path(sys.argv[1])
options = onnxruntime.SessionOptions()
options.intra_op_num_threads = 1
session = onnxruntime.InferenceSession(folder / "model.onnx", options, providers=["CPUExecutionProvider"])
picture = np.fromfile(folder / "picture.f32", "<f4").reshape(416, 640, 3)
images = np.ascontiguousarray(picture.transpose(2, 0, 1)[None])
(output,) = session.run(["output"], {"images": images})
assert output.shape == (1, 4160, 6), output.shape

cells = np.fromfile(folder / "cells.f32", "<f4").reshape(4160, 5)
score = 1 / (1 + np.exp(-cells[:, 0].astype(float)))
score_difference = np.abs(output[0, :, 4] - score).max()

expected = np.array(json.loads((folder / "peaks.json").read_text()))
rows = output[0][(output[0, :, 5] == 1) & (output[0, :, 4] >= 0.01)]
rows = rows[np.argsort(-rows[:, 4], kind="stable")]
assert len(rows) == len(expected) > 10, (len(rows), len(expected))
box_difference = np.abs(rows[:, :4] - expected[:, :4]).max()

two = session.run(["output"], {"images": np.concatenate([images, images[:, :, ::-1]])})[0]
assert np.abs(two[0] - output[0]).max() < 1e-3, "a batch of two gives another answer"

times = []
for _ in range(20):
    start = time.perf_counter()
    session.run(None, {"images": images})
    times.append(time.perf_counter() - start)
print(f"score {score_difference:.1e}, boxes {box_difference:.1e} px, {len(rows)} peaks, {1e3 * min(times):.1f} ms a picture on one thread")
assert score_difference < 1e-4 and box_difference < 1e-2
