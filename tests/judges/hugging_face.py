"""An export for Hugging Face's datasets, loaded without a network, and its videos decoded.

Usage: python hugging_face.py FOLDER     prints JSON: per table and split the columns and rows; per video the images
"""

import json
import os
import sys
import tempfile
from pathlib import Path

cache = tempfile.TemporaryDirectory()
os.environ.update(HF_HOME=cache.name, HF_HUB_OFFLINE="1", HF_DATASETS_OFFLINE="1", HF_DATASETS_DISABLE_PROGRESS_BARS="1")

import av  # noqa: E402
from datasets import get_dataset_config_names, load_dataset  # noqa: E402

folder = Path(sys.argv[1])
tables = {}
for name in get_dataset_config_names(str(folder)):
    loaded = load_dataset(str(folder), name)
    tables[name] = {split: {"columns": rows.column_names, "rows": rows.to_list()} for split, rows in loaded.items()}
videos = {}
for views in tables["views"].values():
    for view in views["rows"]:
        with av.open(folder / view["video"]) as video:
            videos[view["video"]] = sum(1 for _ in video.decode(video=0))
print(json.dumps({"tables": tables, "videos": videos}))
