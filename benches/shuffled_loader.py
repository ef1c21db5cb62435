"""Shuffled samples beside samples in order, through torch's DataLoader, in one run.

    PYTHONPATH=python .venv-torch/bin/python benches/shuffled_loader.py CORPUS [BATCHES]

Rounds alternate. Prints the samples per second of both and their ratio, the mean number of scenarios in a batch of 16, and the rate of
`DataLoader(shuffle=True)` on a few batches. The corpus needs labels, and 16 scenarios for the figure to mean something.
"""

import json
import statistics
import sys
import time
from itertools import islice

from torch.utils.data import DataLoader

from dtd import Corpus
from dtd.shuffled_ticks import ShuffledTicks
from dtd.tick_dataset import TickDataset

ROUNDS = 3
BATCH = 16
RANDOM_BATCHES = 4


def rate(loader: DataLoader, batches: int) -> tuple[float, float]:
    """Samples per second, and scenarios per batch."""
    scenarios, samples = [], 0
    began = time.perf_counter()
    for batch in islice(loader, batches):
        scenarios.append(len(set(batch["scenario"])))
        samples += len(batch["scenario"])
    return samples / (time.perf_counter() - began), statistics.mean(scenarios)


def main() -> None:
    corpus, batches = Corpus(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 100
    ticks = TickDataset(corpus, crop_px=(96, 64))
    in_order, shuffled, mixed = [], [], []
    for epoch in range(ROUNDS):
        in_order.append(rate(DataLoader(ticks, batch_size=BATCH), batches)[0])
        shuffled_ticks = ShuffledTicks(ticks, seed=1)
        shuffled_ticks.set_epoch(epoch)
        speed, scenarios = rate(DataLoader(shuffled_ticks, batch_size=BATCH), batches)
        shuffled.append(speed)
        mixed.append(scenarios)
    at_random, _ = rate(DataLoader(ticks, batch_size=BATCH, shuffle=True), RANDOM_BATCHES)
    print(
        json.dumps({
            "scenarios": len(corpus.ids), "samples": len(ticks), "batches": batches,
            "in_order_per_s": max(in_order), "shuffled_per_s": max(shuffled), "ratio": max(shuffled) / max(in_order), "goal": 0.85,
            "scenarios_per_batch": statistics.mean(mixed), "at_random_per_s": at_random,
        })
    )  # fmt: skip


if __name__ == "__main__":
    main()
