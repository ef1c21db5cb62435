"""Seconds a step of the two stages of `paper_lstm` in PyTorch: `torch_training.py STAGE BATCH STEPS`, STAGE `calibration` or `lstm`.

Layers, losses, optimiser and batches are those of `dtd train`'s defaults with two views: batches drawn with replacement, each of both
views, left alone and right alone in a third of the LSTM's batches.
"""

import sys
import time

import torch
from torch import nn

STAGE, BATCH, STEPS = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
SAMPLES, BOX, FEATURES = 4096, 4, 256
torch.set_num_threads(2)
torch.manual_seed(0)


def dense(*widths):
    layers = []
    for inputs, outputs in zip(widths, widths[1:]):
        layers += [nn.Linear(inputs, outputs), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


distances = torch.rand(SAMPLES, 1)
if STAGE == "calibration":
    views = [torch.randn(SAMPLES, BOX) for _ in range(2)]
    networks = nn.ModuleList([dense(BOX, 128, 128, FEATURES) for _ in views] + [dense(FEATURES, 128, 1)])

    def loss(step, rows):
        found = [networks[-1](networks[view](boxes[rows])) for view, boxes in enumerate(views)]
        truth = distances[rows]
        own = sum(((one - truth) ** 2).mean() for one in found)
        return own + ((found[0] - found[1].detach()) ** 2).mean() + ((found[1] - found[0].detach()) ** 2).mean()

else:
    features = torch.randn(SAMPLES, 2, FEATURES)
    networks = nn.ModuleList([nn.LSTM(FEATURES, 256, num_layers=2, batch_first=True), dense(256, 128, 1)])

    def loss(step, rows):
        seen = [slice(0, 2), slice(0, 1), slice(1, 2)][step % 3]
        outputs, _ = networks[0](features[rows, seen])
        return ((networks[1](outputs[:, -1]) - distances[rows]) ** 2).mean()


optimiser = torch.optim.Adam(networks.parameters(), lr=1e-3)
for step in range(-3, STEPS):
    if step == 0:
        began = time.monotonic()
    rows = torch.randint(SAMPLES, (BATCH,))
    optimiser.zero_grad()
    loss(step, rows).backward()
    optimiser.step()
print((time.monotonic() - began) / STEPS)
