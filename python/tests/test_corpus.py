"""Reads a corpus that `dtd` has just recorded and labelled; `tests/python_package.rs` makes it and what to expect."""

import json
import os
import shutil
import tempfile
import unittest
from pathlib import Path

import numpy as np
import polars as pl

from dtd import Corpus, CorpusError
from dtd.camera import ecef_m

PATH = Path(os.environ["DTD_CORPUS"])
EXPECTED = json.loads(Path(os.environ["DTD_EXPECTED"]).read_text())
SCENARIO = EXPECTED["scenario"]
VIEWS = ["lens", "mast", "tower_2"]


class Tables(unittest.TestCase):
    def setUp(self) -> None:
        self.corpus = Corpus(PATH)

    def test_ticks_of_all_scenarios_stand_in_one_table(self) -> None:
        ticks = self.corpus.ticks()
        self.assertEqual(ticks["scenario"].unique().sort().to_list(), self.corpus.ids)
        self.assertEqual(len(ticks.filter(pl.col("scenario") == SCENARIO)), EXPECTED["ticks"])
        self.assertEqual(ticks["dtd_m"].null_count(), 0)
        self.assertFalse([name for name in ticks.columns if name.endswith(tuple(VIEWS))])

    def test_columns_of_a_view_become_rows(self) -> None:
        views = self.corpus.views()
        self.assertEqual(len(views), len(VIEWS) * len(self.corpus.ticks()))
        first = views.filter(pl.col("scenario") == SCENARIO, pl.col("tick") == 1)
        self.assertEqual(first["view"].to_list(), VIEWS)
        self.assertEqual(first["pts"].to_list(), [1001] * 3)
        self.assertIn("camera_hfov_deg", views.columns)

    def test_a_scenario_says_what_it_is(self) -> None:
        scenarios = self.corpus.scenarios()
        self.assertEqual(scenarios["scenario"].to_list(), self.corpus.ids)
        self.assertEqual(scenarios["weather"].to_list(), ["clear"] * 2)
        self.assertAlmostEqual(scenarios["frame_rate"][0], 30_000 / 1_001)
        self.assertLessEqual(set(scenarios["side"]), {"train", "validation", "test"})

    def test_what_is_not_there_is_said_with_what_to_do(self) -> None:
        with self.assertRaisesRegex(CorpusError, "dtd detect"):
            self.corpus.detections()
        with self.assertRaisesRegex(CorpusError, "'left' is no view .* lens, mast, tower_2"):
            self.corpus.frame(SCENARIO, "left", 0)
        with self.assertRaisesRegex(CorpusError, "'gone' is no complete scenario"):
            self.corpus.record("gone")
        with self.assertRaisesRegex(CorpusError, "no folder scenarios/"):
            Corpus(PATH / "scenarios")
        with self.assertRaises(IndexError):
            self.corpus.frame(SCENARIO, "mast", EXPECTED["ticks"])

    def test_a_scenario_that_is_being_replaced_is_read_by_its_new_seal(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / "corpus"
            shutil.copytree(PATH, copy)
            scenario = copy / "scenarios" / SCENARIO
            (scenario / "boxes_truth.parquet").rename(scenario / "boxes_truth.parquet.new")
            (scenario / "DONE.json").rename(scenario / "DONE.json.new")
            (scenario.with_name("x.partial")).mkdir()
            replaced = Corpus(copy)
            self.assertEqual(replaced.ids, self.corpus.ids)
            self.assertTrue(replaced.boxes().equals(self.corpus.boxes()))


class Cameras(unittest.TestCase):
    def test_points_fall_where_dtd_sees_them(self) -> None:
        points = ecef_m(*np.array(EXPECTED["points"]).T)
        for view in VIEWS:
            expected = np.array([pixel or [np.nan] * 2 for pixel in EXPECTED["cameras"][view]])
            found = Corpus(PATH).camera(SCENARIO, view).project(points)
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)

    def test_true_boxes_hold_the_aircraft(self) -> None:
        corpus = Corpus(PATH)
        boxes = corpus.boxes().filter(scenario=SCENARIO, view="mast", truncation=0)
        rows = boxes.join(corpus.ticks(), on=["scenario", "tick"])
        self.assertGreater(len(rows), 10)
        pixel = corpus.camera(SCENARIO, "mast").project(
            ecef_m(rows["latitude_deg"], rows["longitude_deg"], rows["altitude_msl_m"])
        )
        self.assertTrue((abs(pixel[:, 0] - rows["cx_px"].to_numpy()) < rows["width_px"].to_numpy() / 2).all())


class Pictures(unittest.TestCase):
    def setUp(self) -> None:
        self.corpus = Corpus(PATH)
        self.expected = np.array(EXPECTED["picture"], np.uint8).reshape(96, 160, 3)

    def test_a_picture_is_that_of_its_tick(self) -> None:
        found = self.corpus.frame(SCENARIO, "mast", EXPECTED["tick"])
        self.assertEqual(found.shape, (96, 160, 3))
        self.assertLessEqual(abs(found.astype(int) - self.expected).max(), 3)

    def test_reading_in_order_and_jumping_give_the_same_pictures(self) -> None:
        in_order = list(self.corpus.frames(SCENARIO, "mast"))
        self.assertEqual(len(in_order), EXPECTED["ticks"])
        with self.corpus.video(SCENARIO, "mast") as video:
            for tick in [EXPECTED["tick"], 3, 4, EXPECTED["ticks"] - 1, 0]:
                np.testing.assert_array_equal(video[tick], in_order[tick])


if __name__ == "__main__":
    unittest.main()
