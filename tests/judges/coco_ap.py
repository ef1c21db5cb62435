"""Average precision as pycocotools computes it.

Usage: python coco_ap.py TRUTH.json DETECTIONS.json     in COCO's format; prints JSON, null where pycocotools says -1
"""

import contextlib
import io
import json
import sys

from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

with contextlib.redirect_stdout(io.StringIO()):
    truth = COCO(sys.argv[1])
    found = truth.loadRes(sys.argv[2])
    evaluation = COCOeval(truth, found, "bbox")
    evaluation.evaluate()
    evaluation.accumulate()
    evaluation.summarize()
names = ["ap", "ap50", "ap75", "ap_small", "ap_medium", "ap_large"]
print(json.dumps({name: None if value < 0 else value for name, value in zip(names, evaluation.stats.tolist())}))
