"""Shards of crops as webdataset iterates over them, against the whole images of the same corpus and the crops of the Python package.

Every crop must have the pixels of its image at the place that it names, and the samples and places must be those of `TickDataset`.

Usage: python crops.py SHARDS PICTURES CORPUS     (PICTURES: images of a COCO export)
Prints JSON: per shard, the samples in their order: key, JSON, and by view how much the ground-truth box stands out: the mean
difference from the crop's median colour inside the box, over the same on both sides of it; null if there is no room on the sides.
"""

import json
import sys
from pathlib import Path

import numpy as np
import webdataset
from PIL import Image

from dtd import Corpus
from dtd.tick_dataset import TickDataset

shards, images, corpus = map(Path, sys.argv[1:])


def contrast(crop, box):
    left, top, width, height = (round(value) for value in box)
    width, height = max(width, 2), max(height, 2)
    rows = slice(max(top, 0), top + height)
    off = np.abs(crop.astype(float) - np.median(crop, axis=(0, 1))).mean(axis=2)[rows]
    inside = off[:, max(left, 0) : left + width]
    beside = [off[:, max(left - 2 * width, 0) : max(left - width, 0)], off[:, left + 2 * width : left + 3 * width]]
    beside = np.concatenate(beside, axis=1)
    return inside.mean() / max(beside.mean(), 0.1) if beside.size else None


found = {}
corners = {}
for shard in sorted(shards.glob("*.tar")):
    samples = found[shard.name] = []
    for sample in webdataset.WebDataset([str(shard)], shardshuffle=False).decode("rgb8"):
        known = sample["json"]
        contrasts = {}
        for view, of_view in known["views"].items():
            crop = sample[f"{view}.png"]
            place = of_view["crop"]
            left, top = place["left_px"], place["top_px"]
            assert crop.shape == (place["height_px"], place["width_px"], 3)
            whole = np.asarray(Image.open(images / f"{known['scenario']}_{view}_{known['tick']:06}.png"))
            assert (whole[top : top + crop.shape[0], left : left + crop.shape[1]] == crop).all(), sample["__key__"]
            contrasts[view] = contrast(crop, of_view["truth"][0]["bbox"])
            corners[known["scenario"], known["tick"], view] = (left, top)
        size_px = crop.shape[1::-1]
        samples.append({"key": sample["__key__"], "json": known, "contrast": contrasts})

package = TickDataset(Corpus(corpus), crop_px=size_px)
theirs = {}
for index in range(len(package)):
    sample = package[index]
    for view, corner in sample["corners_px"].items():
        theirs[sample["scenario"], sample["tick"], view] = tuple(corner.tolist())
assert theirs == corners, set(theirs.items()) ^ set(corners.items())
print(json.dumps(found))
