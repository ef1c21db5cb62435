"""A dataset for YOLO as Ultralytics' own check of images and labels sees it.

The package imports torch, which weighs gigabytes. Its check does not need it: the functions are taken from the package's source.

Usage: python yolo_labels.py FOLDER     prints JSON: per side of data.yaml, images with labels, images without, and boxes
"""

import ast
import json
import os
import sys
from importlib.metadata import distribution
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

WANTED = {"IMG_FORMATS", "VID_FORMATS", "FORMATS_HELP_MSG", "img2label_paths", "exif_size", "check_image", "verify_image_label"}

source = distribution("ultralytics").locate_file("ultralytics/data/utils.py")
module = ast.parse("from __future__ import annotations\n" + Path(source).read_text())
kept = [node for node in module.body if getattr(node, "name", None) in WANTED]
kept += [node for node in module.body if isinstance(node, ast.Assign) and node.targets[0].id in WANTED]
module.body = [module.body[0]] + sorted(kept, key=lambda node: node.lineno)
check = {"np": np, "os": os, "Path": Path, "Image": Image}
exec(compile(module, str(source), "exec"), check)

folder = Path(sys.argv[1])
data = yaml.safe_load((folder / "data.yaml").read_text())
found = {}
for side in ("train", "val", "test"):
    if side not in data:
        continue
    pictures = sorted(str(path) for path in (folder / data[side]).iterdir())
    counts = {"labelled": 0, "empty": 0, "boxes": 0}
    for picture, label in zip(pictures, check["img2label_paths"](pictures)):
        given = (picture, label, "", False, len(data["names"]), 0, 0, False)
        _, boxes, _, _, _, missing, labelled, empty, corrupt, message = check["verify_image_label"](given)
        assert not (missing or corrupt or message), f"{picture}: {message or 'no label file'}"
        counts["empty"] += empty
        counts["labelled"] += labelled - empty
        counts["boxes"] += len(boxes)
    found[side] = counts
print(json.dumps({"names": data["names"], "sides": found}))
