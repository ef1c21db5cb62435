"""Samples through torch itself: a true Dataset, whose loaders give the same as reading it directly.

Needs torch: `tests/python_package.rs` runs it with the Python of .venv-torch, apart from the other tests.
"""

import os
import unittest
from pathlib import Path

import torch
from torch.utils.data import DataLoader, Dataset, IterableDataset

from dtd import Corpus
from dtd.shuffled_ticks import ShuffledTicks
from dtd.tick_dataset import TickDataset

PATH = Path(os.environ["DTD_CORPUS"])


class Loaders(unittest.TestCase):
    def test_a_loader_batches_what_the_dataset_has_with_any_workers(self) -> None:
        dataset = TickDataset(Corpus(PATH), views=["mast", "lens"], every=7, crop_px=(40, 24))
        self.assertIsInstance(dataset, Dataset)
        samples = [dataset[index] for index in range(len(dataset))]
        for workers, method in ((0, None), (2, "fork"), (2, "spawn")):
            loader = DataLoader(dataset, batch_size=5, num_workers=workers, multiprocessing_context=method)
            place = 0
            for batch in loader:
                self.assertEqual(batch["pictures"]["lens"].dtype, torch.uint8)
                self.assertEqual(tuple(batch["pictures"]["lens"].shape[1:]), (24, 40, 3))
                for number, scenario in enumerate(batch["scenario"]):
                    sample = samples[place]
                    place += 1
                    self.assertEqual((scenario, batch["tick"][number].item()), (sample["scenario"], sample["tick"]))
                    self.assertEqual(batch["dtd_m"][number].item(), sample["dtd_m"])
                    for view in ("mast", "lens"):
                        self.assertTrue((batch["pictures"][view][number].numpy() == sample["pictures"][view]).all())
                        self.assertTrue((batch["boxes"][view][number].numpy() == sample["boxes"][view]).all())
            self.assertEqual(place, len(samples))

    def test_workers_share_a_shuffled_epoch(self) -> None:
        ticks = TickDataset(Corpus(PATH), views=["mast"], every=7, crop_px=(40, 24))
        shuffled = ShuffledTicks(ticks, seed=5)
        self.assertIsInstance(shuffled, IterableDataset)
        expected = sorted((ticks[index]["scenario"], ticks[index]["tick"]) for index in range(len(ticks)))
        for workers in (0, 2):
            loader = DataLoader(shuffled, batch_size=4, num_workers=workers)
            seen = [
                (scenario, tick.item())
                for batch in loader
                for scenario, tick in zip(batch["scenario"], batch["tick"], strict=True)
            ]
            self.assertEqual(sorted(seen), expected)

    def test_workers_that_persist_shuffle_each_epoch_anew(self) -> None:
        shuffled = ShuffledTicks(TickDataset(Corpus(PATH), views=["mast"], every=7, crop_px=(40, 24)), seed=5)
        for method in ("fork", "spawn"):
            loader = DataLoader(
                shuffled,
                num_workers=1,
                persistent_workers=True,
                multiprocessing_context=method,
            )

            def order(epoch: int, loader: DataLoader = loader) -> list[tuple[str, int]]:
                shuffled.set_epoch(epoch)
                return [(batch["scenario"][0], batch["tick"].item()) for batch in loader]

            first = order(0)
            self.assertNotEqual(order(1), first)
            self.assertEqual(order(0), first)


if __name__ == "__main__":
    unittest.main()
