"""LeRobot datasets merged into one by their own library.

Usage: python lerobot_merge.py OUT FOLDER...    prints JSON: episodes and frames of the result, and by camera how many images the files
of its videos have and how many of the results' frames have an image at their time
"""

import json
import os
import sys
import tempfile
from pathlib import Path

home = tempfile.TemporaryDirectory()
os.environ.update(HF_HOME=home.name, HF_HUB_OFFLINE="1", HF_DATASETS_OFFLINE="1")

import av  # noqa: E402
import numpy as np  # noqa: E402
from lerobot.datasets.dataset_tools import merge_datasets  # noqa: E402
from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: E402

WITHIN_S = 1e-4

out, *folders = map(Path, sys.argv[1:])
# FFmpeg by way of torchvision: the library's other way needs a torchvision newer than Debian's.
datasets = [LeRobotDataset(f"dtd/{folder.name}", root=folder, video_backend="video_reader") for folder in folders]
merged = merge_datasets(datasets, "dtd/merged", output_dir=out)
cameras = {}
for key in merged.meta.video_keys:
    times = {}
    for path in sorted(out.glob(f"videos/{key}/*/*")):
        with av.open(str(path)) as video:
            times[path] = np.array([frame.time for frame in video.decode(video=0)])
    found = 0
    for episode in merged.meta.episodes:
        path = out / merged.meta.get_video_file_path(episode["episode_index"], key)
        for frame in range(episode["length"]):
            wanted = episode[f"videos/{key}/from_timestamp"] + frame / merged.fps
            found += bool(abs(times[path] - wanted).min() < WITHIN_S)
    cameras[key] = {"pictures": sum(map(len, times.values())), "frames_with_picture": found}
print(json.dumps({"episodes": merged.num_episodes, "frames": merged.num_frames, "cameras": cameras}))
