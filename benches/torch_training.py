#!/usr/bin/env python3
"""Steps a second of the two stages of `dtd train`'s `paper_lstm`, as a multiple of PyTorch's, two threads each.

    cargo build --release && cargo run --release --workspace --example synthetic_corpus -- CORPUS
    python3 benches/torch_training.py CORPUS [STEPS]        # needs PyTorch, e.g. Debian's python3-torch

Layers, losses, optimiser and batches are `dtd train`'s defaults with two views: batches drawn with replacement; each view alone and both
together in a third of the LSTM's batches. A stage of `dtd train` is what STEPS more steps take, so that all else is left out. Both
are timed in turn, several times, and the middle ratio is printed with the lowest and the highest.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import torch
from torch import nn

SAMPLES, BOX, FEATURES = 4096, 4, 256
ROUNDS = 5
DTD = Path(__file__).parents[1] / "target/release/dtd"


def dense(*widths):
    layers = []
    for inputs, outputs in zip(widths, widths[1:]):
        layers += [nn.Linear(inputs, outputs), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


def calibration():
    """Networks, and the loss of a batch: error of each view and its distance from the other."""
    views = [torch.randn(SAMPLES, BOX) for _ in range(2)]
    networks = nn.ModuleList([dense(BOX, 128, 128, FEATURES) for _ in views] + [dense(FEATURES, 128, 1)])

    def loss(step, rows, truth):
        found = [networks[2](networks[view](boxes[rows])) for view, boxes in enumerate(views)]
        apart = sum(((one - other.detach()) ** 2).mean() for one, other in [found, found[::-1]])
        return sum(((one - truth) ** 2).mean() for one in found) + apart

    return networks, loss


def estimator():
    """Networks, and the loss of a batch. The calibration networks before the LSTM are frozen."""
    views = torch.randn(SAMPLES, 2, BOX)
    frozen = [dense(BOX, 128, 128, FEATURES) for _ in range(2)]
    networks = nn.ModuleList([nn.LSTM(FEATURES, 256, num_layers=2, batch_first=True), dense(256, 128, 1)])

    def loss(step, rows, truth):
        seen = [[0, 1], [0], [1]][step % 3]
        with torch.no_grad():
            features = torch.stack([frozen[view](views[rows, view]) for view in seen], dim=1)
        outputs, _ = networks[0](features)
        return ((networks[1](outputs[:, -1]) - truth) ** 2).mean()

    return networks, loss


def seconds_in_torch(stage, batch, steps):
    networks, loss = stage()
    optimiser = torch.optim.Adam(networks.parameters(), lr=1e-3)
    distances = torch.rand(SAMPLES, 1)
    for step in range(-3, steps):
        if step == 0:
            began = time.monotonic()
        rows = torch.randint(SAMPLES, (batch,))
        optimiser.zero_grad()
        loss(step, rows, distances[rows]).backward()
        optimiser.step()
    return time.monotonic() - began


def seconds_of_train(corpus, stage, batch, steps):
    """Everything else in it takes one step."""
    tables = []
    for table in ["calibration", "estimator", "mono"]:
        if table != "mono":
            tables.append(f"{table}.log_every = 100000")
        its_steps = steps if table == stage else 1
        tables.append(f"{table}.optimisation = {{ steps = {its_steps}, batch_size = {batch}, learning_rate = 1e-3 }}")
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "train.toml")
        config.write_text("\n".join(tables))
        began = time.monotonic()
        command = [DTD, "train", corpus, "--out", Path(folder, "run"), "--config", config]
        subprocess.run(command, check=True, capture_output=True)
        return time.monotonic() - began


def main():
    corpus, steps = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 200
    torch.set_num_threads(2)
    for stage in [calibration, estimator]:
        for batch in [256, 1024, 4096]:
            ratios = []
            for _ in range(ROUNDS):
                ours = -seconds_of_train(corpus, stage.__name__, batch, 1)
                ours += seconds_of_train(corpus, stage.__name__, batch, 1 + steps)
                ratios.append(seconds_in_torch(stage, batch, steps) / ours)
            lowest, *_, highest = ratios = sorted(ratios)
            middle = ratios[ROUNDS // 2]
            print(f"{stage.__name__}, batches of {batch}: {middle:.2f} ({lowest:.2f} to {highest:.2f})", flush=True)


if __name__ == "__main__":
    main()
