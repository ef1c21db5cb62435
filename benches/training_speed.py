"""Training of both stages of `paper_lstm` against the same networks in PyTorch, with the paper's layers and two views, on the processor.

    [THREADS=N] PYTHON_WITH_TORCH benches/training_speed.py [BATCH_SIZE...]        (default: all cores; 256 1024 4096)

Takes a Python with PyPI's torch: Debian's multiplies matrices several times slower. Builds and runs `trainer/examples/training_speed.rs`.
Rounds alternate, so that a busy machine is busy for both; the best of each counts. With more than one thread PyTorch suffers from a busy
machine more than we do.
"""

import os
import subprocess
import sys
import time

import torch
from torch import nn

ROUNDS = 3
STEPS = 12
BUILD = "cargo build --quiet --release --locked --workspace --example training_speed".split()
EXAMPLE = "target/release/examples/training_speed"


def dense(*widths):
    layers = []
    for inputs, outputs in zip(widths, widths[1:]):
        layers += [nn.Linear(inputs, outputs), nn.LeakyReLU()]
    return nn.Sequential(*layers[:-1])


class Estimator(nn.Module):
    """Stage two, on features of frozen calibration networks."""

    def __init__(self):
        super().__init__()
        self.lstm = nn.LSTM(256, 256, num_layers=2, batch_first=True)
        self.head = dense(256, 128, 1)

    def loss(self, features, distances):
        output, _ = self.lstm(features)
        return nn.functional.mse_loss(self.head(output[:, -1]), distances)


class Calibration(nn.Module):
    """Stage one, with the loss of equation 1."""

    def __init__(self):
        super().__init__()
        self.views = nn.ModuleList(dense(4, 128, 128, 256) for _ in range(2))
        self.head = dense(256, 128, 1)

    def loss(self, boxes, distances):
        predicted = [self.head(view(boxes[:, number])) for number, view in enumerate(self.views)]
        apart = nn.functional.mse_loss
        alone = sum(apart(prediction, distances) for prediction in predicted)
        return alone + apart(predicted[0], predicted[1].detach()) + apart(predicted[1], predicted[0].detach())


def samples_per_s(network, inputs, batch_size):
    batch = torch.randn(batch_size, 2, inputs), torch.rand(batch_size, 1)
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-3)

    def steps(count):
        started = time.perf_counter()
        for _ in range(count):
            optimiser.zero_grad()
            network.loss(*batch).backward()
            optimiser.step()
        return time.perf_counter() - started

    steps(STEPS)
    return 2 * STEPS * batch_size / steps(2 * STEPS)


def main():
    batch_sizes = [int(size) for size in sys.argv[1:]] or [256, 1024, 4096]
    threads = int(os.environ.get("THREADS", os.cpu_count()))
    torch.set_num_threads(threads)
    environment = os.environ | {"RAYON_NUM_THREADS": str(threads)}
    subprocess.run(BUILD, check=True)
    best = {}

    def note(stage, batch_size, side, speed):
        sides = best.setdefault((stage, batch_size), {"dtd": 0.0, "torch": 0.0})
        sides[side] = max(sides[side], speed)

    for _ in range(ROUNDS):
        run = subprocess.run([EXAMPLE, "cpu", str(STEPS), *map(str, batch_sizes)], check=True, capture_output=True, text=True, env=environment)
        for line in run.stdout.splitlines():
            stage, batch_size, speed = line.split("\t")
            note(stage, int(batch_size), "dtd", float(speed))
        for batch_size in batch_sizes:
            note("calibration networks", batch_size, "torch", samples_per_s(Calibration(), 4, batch_size))
            note("distance estimator", batch_size, "torch", samples_per_s(Estimator(), 256, batch_size))
    print(f"PyTorch {torch.__version__}, {torch.get_num_threads()} threads; samples a second, best of {ROUNDS} rounds")
    for (stage, batch_size), sides in sorted(best.items()):
        print(f"{stage:22}{batch_size:6}{sides['dtd']:10.0f}{sides['torch']:10.0f}{sides['dtd'] / sides['torch']:8.2f}")


if __name__ == "__main__":
    main()
