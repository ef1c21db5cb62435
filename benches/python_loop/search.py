"""Searches videos for aircraft as one would in Python: OpenCV decodes, ONNX Runtime runs the model, NumPy does the rest.

    search.py plain|sahi MODEL.onnx PICTURES BANDS VIDEO...

`plain` looks at the same windows as `dtd detect --mode full`: the whole image, or tiles if the model has a fixed size, and then a window
around each hit. BANDS is a JSON list of `[top, bottom, shrink]`: a model that takes any size sees only these rows, each band shrunk by its
factor; `[]` is the whole image. `sahi` gives each image to SAHI's `get_sliced_prediction` with slices of 640 pixels. Each video is read
up to PICTURES images. Prints one JSON object: pictures, boxes, seconds and processor seconds, start and loading left out.

The model's output is `[batch, candidates, 6]`: centre, size (pixels), objectness, class score, as `models/README.md` says.
"""

import json
import math
import sys
import time

import cv2
import numpy as np
import onnxruntime

TILE_SCORE, SCORE, MERGE_IOU, MAX_WINDOWS = 0.15, 0.4, 0.3, 6
USUAL_PX = 640
STRIDE_PX = 32
CROP_PX = (160, 256)
MAX_SHARE = 0.65
PADDING = 114


def multiple(side):
    return math.ceil(side / STRIDE_PX) * STRIDE_PX


class Model:
    """A model and the size of its windows; None if it takes any."""

    def __init__(self, path):
        self.session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        entry = self.session.get_inputs()[0]
        self.input = entry.name
        height, width = entry.shape[2:]
        self.size = (width, height) if isinstance(width, int) and isinstance(height, int) else None

    def boxes(self, picture, left, top, width, height, floor, shrink=1):
        """Boxes in a window of an image, in its coordinates: rows of edges and score."""
        window = picture[top : top + height * shrink, left : left + width * shrink]
        if shrink > 1:
            window = cv2.resize(window, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA)
        if window.shape[:2] != (height, width):
            whole = np.full((height, width, 3), PADDING, np.uint8)
            whole[: window.shape[0], : window.shape[1]] = window
            window = whole
        planes = np.ascontiguousarray(window.transpose(2, 0, 1)[None], np.float32) / 255
        rows = self.session.run(None, {self.input: planes})[0][0]
        scores = rows[:, 4] * rows[:, 5]
        keep = scores >= floor
        centre = (rows[keep, :2] + 0.5) * shrink - 0.5 + (left, top)
        half = rows[keep, 2:4] * shrink / 2
        return np.column_stack([centre - half, centre + half, scores[keep]])


def iou(one, others):
    low, high = np.maximum(one[:2], others[:, :2]), np.minimum(one[2:4], others[:, 2:4])
    overlap = np.clip(high - low, 0, None).prod(axis=1)
    area = lambda boxes: (boxes[..., 2:4] - boxes[..., :2]).prod(axis=-1)
    return overlap / (area(one) + area(others) - overlap)


def best(boxes):
    boxes = boxes[np.argsort(-boxes[:, 4], kind="stable")]
    kept = []
    while len(boxes) and len(kept) < MAX_WINDOWS:
        kept.append(boxes[0])
        boxes = boxes[1:][iou(boxes[0], boxes[1:]) <= MERGE_IOU]
    return np.array(kept).reshape(-1, 5)


def around(box, model, picture):
    size = box[2:4] - box[:2]
    width, height = model.size or [multiple(min(max(size.max() / MAX_SHARE, CROP_PX[0]), CROP_PX[1]))] * 2
    start = lambda centre, side, most: int(min(max(round(centre - (side - 1) / 2), 0), max(most - side, 0)))
    centre = (box[:2] + box[2:4]) / 2
    return start(centre[0], width, picture.shape[1]), start(centre[1], height, picture.shape[0]), width, height


def band_window(picture, top, bottom, shrink):
    height, width = picture.shape[:2]
    across, down = multiple(math.ceil(width / shrink)), multiple(math.ceil((min(bottom, height) - top) / shrink))
    return 0, min(top, max(height - down * shrink, 0)), across, down, shrink


def search(model, picture, bands):
    height, width = picture.shape[:2]
    if model.size is None:
        windows = [band_window(picture, *band) for band in bands or [(0, height, 1)]]
    else:
        across, down = model.size
        windows = [(x, y, across, down, 1) for y in range(0, height, down) for x in range(0, width, across)]
    hits = best(np.concatenate([model.boxes(picture, *window, TILE_SCORE, shrink) for *window, shrink in windows]))
    found = []
    for hit in hits:
        boxes = model.boxes(picture, *around(hit, model, picture), SCORE)
        boxes = boxes[iou(hit, boxes) > 0]
        if len(boxes):
            found.append(boxes[boxes[:, 4].argmax()])
    return len(best(np.array(found).reshape(-1, 5)))


def sliced(path):
    """A search with SAHI's slices."""
    from sahi.models.base import DetectionModel
    from sahi.predict import get_sliced_prediction
    from sahi.prediction import ObjectPrediction

    class Sliced(DetectionModel):
        def load_model(self):
            self.model = Model(path)
            self.category_mapping = {"0": "aircraft"}

        def perform_inference(self, image):
            height, width = image.shape[:2]
            size = self.model.size or (multiple(width), multiple(height))
            self._original_predictions = self.model.boxes(image, 0, 0, *size, SCORE)

        def _create_object_prediction_list_from_original_predictions(self, shift_amount_list=None, full_shape_list=None):
            shift = (shift_amount_list or [[0, 0]])[0]
            full = (full_shape_list or [None])[0]
            shift = shift[0] if isinstance(shift[0], list) else shift
            full = full[0] if full and isinstance(full[0], list) else full
            self._object_prediction_list_per_image = [
                [
                    ObjectPrediction(
                        bbox=[float(edge) for edge in row[:4]],
                        category_id=0,
                        category_name="aircraft",
                        score=float(row[4]),
                        shift_amount=shift,
                        full_shape=full,
                    )
                    for row in self._original_predictions
                    if row[2] - row[0] >= 1 and row[3] - row[1] >= 1
                ]
            ]

    model = Sliced(model_path=path, confidence_threshold=SCORE, device="cpu", load_at_init=True)

    def one(picture):
        found = get_sliced_prediction(
            picture,
            model,
            slice_height=USUAL_PX,
            slice_width=USUAL_PX,
            overlap_height_ratio=0,
            overlap_width_ratio=0,
            perform_standard_pred=False,
            verbose=0,
        )
        return len(found.object_prediction_list)

    return one


def main():
    way, path, most, bands, *videos = sys.argv[1:]
    bands = json.loads(bands)
    if way == "sahi":
        one = sliced(path)
    else:
        model = Model(path)
        one = lambda picture: search(model, picture, bands)
    pictures = boxes = 0
    began, began_cpu = time.perf_counter(), time.process_time()
    for video in videos:
        frames = cv2.VideoCapture(video)
        for _ in range(int(most)):
            there, frame = frames.read()
            if not there:
                break
            boxes += one(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB))
            pictures += 1
    spent = {"seconds": time.perf_counter() - began, "cpu_seconds": time.process_time() - began_cpu}
    print(json.dumps({"pictures": pictures, "boxes": boxes, **spent}))


main()
