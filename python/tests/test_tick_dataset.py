"""Samples of a corpus without torch; torch_loader.py has what needs it."""

import multiprocessing
import os
import pickle
import subprocess
import sys
import unittest
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from dtd import Corpus, CorpusError
from dtd.tick_dataset import TickDataset

PATH = Path(os.environ["DTD_CORPUS"])


def sums(dataset: TickDataset, indices: list[int]) -> list[list[int]]:
    """What tells images apart, cheaply sent between processes."""
    return [[int(picture.astype(int).sum()) for picture in dataset[index]["pictures"].values()] for index in indices]


def answer(answers: Any, dataset: TickDataset, indices: list[int]) -> None:
    answers.put(sums(dataset, indices))


class Samples(unittest.TestCase):
    def setUp(self) -> None:
        self.corpus = Corpus(PATH)

    def test_a_sample_is_what_the_corpus_has_of_its_tick(self) -> None:
        dataset = TickDataset(self.corpus, views=["mast", "tower_2"], every=40)
        ticks = self.corpus.ticks().filter(pl.col("tick") % 40 == 0)
        self.assertEqual(len(dataset), len(ticks))
        boxes = self.corpus.boxes()
        for index in (0, len(dataset) - 1):
            sample, row = dataset[index], ticks.row(index, named=True)
            for name in ("scenario", "tick", "time_ns", "dtd_m"):
                self.assertEqual(sample[name], row[name])
            for view in ("mast", "tower_2"):
                picture = self.corpus.frame(row["scenario"], view, row["tick"])
                np.testing.assert_array_equal(sample["pictures"][view], picture)
                box = boxes.filter(scenario=row["scenario"], tick=row["tick"], view=view)
                expected = box["cx_px"][0] if len(box) else np.nan
                np.testing.assert_equal(sample["boxes"][view][0], expected)
        with self.assertRaises(IndexError):
            dataset[len(dataset)]
        with self.assertRaises(ValueError):
            TickDataset(self.corpus, every=0)

    def test_a_sample_that_is_edited_leaves_the_dataset_as_it_was(self) -> None:
        dataset = TickDataset(self.corpus, views=["mast"], crop_px=(41, 21))
        before = dataset[0]["boxes"]["mast"].copy()
        dataset[0]["boxes"]["mast"][:] = 0
        np.testing.assert_array_equal(dataset[0]["boxes"]["mast"], before)

    def test_a_crop_is_cut_around_the_box_and_stays_in_the_picture(self) -> None:
        whole = TickDataset(self.corpus, views=["mast"])
        crops = TickDataset(self.corpus, views=["mast"], crop_px=(41, 21))
        boxes = self.corpus.boxes().filter(view="mast")
        self.assertEqual(len(crops), len(boxes))
        with_box = [index for index in range(len(whole)) if not np.isnan(whole._boxes["mast"][index]).any()]
        for index in (0, len(crops) // 2, len(crops) - 1):
            crop, picture = crops[index], whole[with_box[index]]["pictures"]["mast"]
            (right, down), box = crop["corners_px"]["mast"], crop["boxes"]["mast"]
            np.testing.assert_array_equal(crop["pictures"]["mast"], picture[down : down + 21, right : right + 41])
            middle = box[:2] - (right, down)
            centred = abs(middle - (20, 10)).max() <= 0.5
            at_edge = right in (0, 160 - 41) or down in (0, 96 - 21)
            self.assertTrue(centred or at_edge, f"{middle}")

    def test_boxes_may_be_those_of_another_table(self) -> None:
        moved = self.corpus.boxes().with_columns(pl.col("cx_px") + 1000)
        sample = TickDataset(self.corpus, views=["mast"], boxes=moved)[20]
        true = TickDataset(self.corpus, views=["mast"])[20]
        self.assertEqual(sample["boxes"]["mast"][0], true["boxes"]["mast"][0] + 1000)
        twice = pl.concat([moved, moved])
        with self.assertRaises(pl.exceptions.ComputeError):
            TickDataset(self.corpus, views=["mast"], boxes=twice)

    def test_boxes_without_a_number_are_none(self) -> None:
        height = pl.when(pl.col("tick") % 2 == 0).then(float("nan")).otherwise(pl.col("cy_px"))
        boxes = self.corpus.boxes().with_columns(height.alias("cy_px"))
        dataset = TickDataset(self.corpus, views=["mast"], boxes=boxes, crop_px=(40, 24))
        self.assertEqual({dataset[index]["tick"] % 2 for index in range(len(dataset))}, {1})
        with self.assertRaisesRegex(CorpusError, "views mast, lens"):
            TickDataset(self.corpus, views=["mast", "lens"], boxes=boxes.filter(view="mast"), crop_px=(40, 24))

    def test_threads_may_share_a_dataset(self) -> None:
        dataset = TickDataset(self.corpus, views=["mast", "lens"], every=9, open_videos=1)
        expected = sums(dataset, list(range(len(dataset))))
        with ThreadPoolExecutor(4) as pool:
            self.assertEqual(list(pool.map(lambda index: sums(dataset, [index])[0], range(len(dataset)))), expected)

    def test_sides_and_scenarios_are_chosen_and_their_names_checked(self) -> None:
        sides = self.corpus.scenarios()
        for side in sides["side"].unique():
            dataset = TickDataset(self.corpus, side=side, every=100)
            ids = {dataset[index]["scenario"] for index in range(len(dataset))}
            self.assertEqual(ids, set(sides.filter(side=side)["scenario"]))
        one = TickDataset(self.corpus, scenarios=self.corpus.ids[1:], every=100)
        self.assertEqual(one[0]["scenario"], self.corpus.ids[1])
        with self.assertRaisesRegex(CorpusError, "'gone' is no complete scenario"):
            TickDataset(self.corpus, scenarios=["gone"])
        with self.assertRaisesRegex(CorpusError, "'top' is no view"):
            TickDataset(self.corpus, views=["top"])
        with self.assertRaisesRegex(CorpusError, "no scenario with side 'nowhere'"):
            TickDataset(self.corpus, side="nowhere")
        with self.assertRaisesRegex(CorpusError, "does not fit into an image"):
            TickDataset(self.corpus, views=["mast"], crop_px=(161, 20))[0]

    def test_few_open_videos_and_a_transform_change_nothing_else(self) -> None:
        indices = [0, 150, 3]
        plain = TickDataset(self.corpus, every=3)
        expected = sums(plain, indices)
        self.assertEqual(sums(TickDataset(self.corpus, every=3, open_videos=1), indices), expected)
        ticks = TickDataset(self.corpus, every=3, transform=lambda sample: sample["tick"])
        self.assertEqual(ticks[2], 6)

    def test_copies_and_forked_and_spawned_workers_read_the_same_pictures(self) -> None:
        dataset = TickDataset(self.corpus, views=["mast"])
        indices = [50, 51, 7]
        # Videos are open when the workers begin.
        expected = sums(dataset, indices)
        self.assertEqual(sums(pickle.loads(pickle.dumps(dataset)), indices), expected)
        for method in ("fork", "spawn"):
            context = multiprocessing.get_context(method)
            answers = context.Queue()
            # A forked process gets the dataset as it is, with its open videos; a spawned one a copy.
            workers = [context.Process(target=answer, args=(answers, dataset, indices)) for _ in range(2)]
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)
                for worker in workers:
                    worker.start()
            for _ in workers:
                self.assertEqual(answers.get(timeout=60), expected)
            for worker in workers:
                worker.join()
            answers.close()
        self.assertEqual(sums(dataset, indices), expected)

    def test_neither_the_package_nor_a_corpus_imports_torch(self) -> None:
        code = "import sys, dtd; dtd.Corpus(sys.argv[1]); sys.exit('torch' in sys.modules)"
        subprocess.run([sys.executable, "-c", code, str(PATH)], check=True)


if __name__ == "__main__":
    unittest.main()
