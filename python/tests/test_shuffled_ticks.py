"""Shuffled samples of a corpus without torch; torch_loader.py has what needs it."""

import os
import unittest
from itertools import islice
from pathlib import Path
from unittest import mock

import numpy as np

from dtd import Corpus, CorpusError, Video
from dtd.shuffled_ticks import ShuffledTicks
from dtd.tick_dataset import Sample, TickDataset

PATH = Path(os.environ["DTD_CORPUS"])
Place = tuple[str, int]


def places(shuffled: ShuffledTicks) -> list[Place]:
    return [(sample["scenario"], sample["tick"]) for sample in shuffled]


class Shuffled(unittest.TestCase):
    def setUp(self) -> None:
        self.ticks = TickDataset(Corpus(PATH), views=["mast"], every=3)

    def test_each_sample_comes_once_and_is_that_of_the_dataset(self) -> None:
        number_of = {}
        for index in range(len(self.ticks)):
            sample = self.ticks[index]
            number_of[sample["scenario"], sample["tick"]] = index
        shuffled = ShuffledTicks(self.ticks, seed=3)
        self.assertEqual(len(shuffled), len(number_of))
        seen = []
        for sample in shuffled:
            place = sample["scenario"], sample["tick"]
            seen.append(place)
            if len(seen) % 20 == 0:
                expected = self.ticks[number_of[place]]
                np.testing.assert_array_equal(sample["pictures"]["mast"], expected["pictures"]["mast"])
        self.assertEqual(sorted(seen), sorted(number_of))
        self.assertNotEqual(seen, list(number_of))

    def test_seed_and_epoch_determine_the_order(self) -> None:
        def order(seed: int, epoch: int) -> list[Place]:
            shuffled = ShuffledTicks(self.ticks, seed=seed)
            shuffled.set_epoch(epoch)
            return places(shuffled)

        first = order(1, 0)
        self.assertEqual(order(1, 0), first)
        self.assertNotEqual(order(1, 1), first)
        self.assertNotEqual(order(2, 0), first)

    def test_samples_come_from_different_scenarios_in_turn(self) -> None:
        seen = places(ShuffledTicks(self.ticks, runs_at_once=2))
        pairs = list(zip(seen[::2], seen[1::2], strict=False))[: len(seen) // 8]
        self.assertTrue(all(a[0] != b[0] for a, b in pairs))

    def test_samples_are_the_same_whether_there_is_memory_to_decode_ahead_or_not(self) -> None:
        ahead = list(ShuffledTicks(self.ticks, seed=1))
        with mock.patch("dtd.shuffled_ticks.AHEAD_BYTES", 0):
            one_by_one = list(ShuffledTicks(self.ticks, seed=1))
        self.assertEqual(len(ahead), len(one_by_one))
        for one, other in zip(ahead, one_by_one, strict=True):
            self.assertEqual((one["scenario"], one["tick"]), (other["scenario"], other["tick"]))
            np.testing.assert_array_equal(one["pictures"]["mast"], other["pictures"]["mast"])

    def test_a_transform_is_applied_when_a_sample_is_taken(self) -> None:
        seen: list[Place] = []

        def noted(sample: Sample) -> Place:
            seen.append((sample["scenario"], sample["tick"]))
            return seen[-1]

        ticks = TickDataset(Corpus(PATH), views=["mast"], every=3, transform=noted)
        taken = []
        for place in islice(ShuffledTicks(ticks, seed=3), 50):
            taken.append(place)
            self.assertEqual(seen, taken)

    def test_a_video_that_cannot_be_read_is_named_and_the_iteration_ends(self) -> None:
        scenario = self.ticks[0]["scenario"]
        opened = self.ticks.open_video

        def damaged(of: str, view: str, *, is_threaded: bool = True) -> Video:
            if of == scenario:
                raise CorpusError(f"{of} is damaged")
            return opened(of, view, is_threaded=is_threaded)

        with mock.patch.object(self.ticks, "open_video", damaged), self.assertRaisesRegex(CorpusError, f"{scenario} is damaged"):
            list(ShuffledTicks(self.ticks))

    def test_no_run_at_a_time_is_refused(self) -> None:
        with self.assertRaises(ValueError):
            ShuffledTicks(self.ticks, runs_at_once=0)


if __name__ == "__main__":
    unittest.main()
