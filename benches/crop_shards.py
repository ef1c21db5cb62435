"""Crops of the training side out of the shards of `dtd export --to crops` beside crops out of the videos (`ShuffledTicks`), in one run.

    dtd export CORPUS --to crops --out SHARDS
    PYTHONPATH=python .venv/bin/python benches/crop_shards.py CORPUS SHARDS [SAMPLES]

Rounds alternate, in one process without workers of a loader. Prints the crops per second of both, and the mean number of scenarios in a
batch of 16. The corpus needs labels, and 16 scenarios of the training side for that number to mean something.
"""

import glob
import json
import statistics
import sys
import time
from itertools import islice

import webdataset

from dtd import Corpus
from dtd.shuffled_ticks import ShuffledTicks
from dtd.tick_dataset import TickDataset

ROUNDS = 3
BATCH = 16


def shards():
    return webdataset.WebDataset(sorted(glob.glob(f"{sys.argv[2]}/train-*.tar")), shardshuffle=False).decode("rgb8")


def rate(samples, count, scenario_of):
    """Samples per second, and scenarios per batch."""
    began = time.perf_counter()
    scenarios = [scenario_of(sample) for sample in islice(samples, count)]
    took_s = time.perf_counter() - began
    batches = [len(set(scenarios[start : start + BATCH])) for start in range(0, len(scenarios) - BATCH + 1, BATCH)]
    return len(scenarios) / took_s, statistics.mean(batches)


first = next(iter(shards()))["json"]
size_px = next((view["crop"]["width_px"], view["crop"]["height_px"]) for view in first["views"].values())
ticks = TickDataset(Corpus(sys.argv[1]), side="train", crop_px=size_px, views=list(first["views"]))
count = int(sys.argv[3]) if len(sys.argv) > 3 else 100 * BATCH
from_shards, from_videos = [], []
for epoch in range(ROUNDS):
    from_shards.append(rate(shards(), count, lambda sample: sample["json"]["scenario"]))
    shuffled = ShuffledTicks(ticks, seed=1)
    shuffled.set_epoch(epoch)
    from_videos.append(rate(shuffled, count, lambda sample: sample["scenario"]))
crops = len(ticks.views)
best_shards, best_videos = (crops * max(rate for rate, _ in rates) for rates in (from_shards, from_videos))
print(
    json.dumps({
        "crop_px": size_px, "samples": count, "views": crops, "shards_crops_per_s": best_shards, "videos_crops_per_s": best_videos,
        "ratio": best_shards / best_videos, "scenarios_per_batch_in_shards": statistics.mean(mixed for _, mixed in from_shards),
        "scenarios_per_batch_of_videos": statistics.mean(mixed for _, mixed in from_videos),
    })
)  # fmt: skip
