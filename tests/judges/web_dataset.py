"""Shards as webdataset iterates over them: every sample with its decoded images.

Usage: python web_dataset.py FOLDER     prints JSON: shards, and per key of a sample its fields, the sizes of its images and its JSON
"""

import json
import sys
from pathlib import Path

import webdataset

folder = Path(sys.argv[1])
shards = sorted(str(path) for path in folder.glob("*.tar"))
samples = {}
for sample in webdataset.WebDataset(shards, shardshuffle=False, empty_check=True).decode("rgb8"):
    key = sample["__key__"]
    assert key not in samples, f"{key} comes twice"
    pictures = {name: list(value.shape) for name, value in sample.items() if hasattr(value, "shape")}
    samples[key] = {"pictures": pictures, "json": sample["json"], "shard": Path(sample["__url__"]).name}
print(json.dumps({"shards": [Path(shard).name for shard in shards], "samples": samples}))
