"""Reads a corpus that `dtd` has just recorded and labelled; `tests/python_package.rs` makes it and what to expect."""

import gc
import json
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
import unittest
import warnings
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import polars as pl
from blake3 import blake3

from dtd import Corpus, CorpusError
from dtd.camera import ecef_m
from dtd.video import Video

PATH = Path(os.environ["DTD_CORPUS"])
EXPECTED = json.loads(Path(os.environ["DTD_EXPECTED"]).read_text())
SCENARIO = EXPECTED["scenario"]
VIEWS = ["lens", "mast", "tower_2"]


def let_go_of(videos: list[Video]) -> None:
    """What a worker may do with videos that it was forked with: use them, which is refused, close them, and have them collected."""
    for video in videos:
        try:
            video[1]
        except CorpusError as error:
            assert "before this process was forked" in str(error)
            video.close()
        else:
            raise AssertionError("a video of the parent was read")
    videos.clear()
    gc.collect()


def threads() -> int:
    """Number of threads of this process."""
    return len(os.listdir("/proc/self/task"))


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
        self.assertAlmostEqual(scenarios["frame_rate"][0], 10_000 / 1_001)
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

    def test_predictions_are_read_from_a_table_and_from_the_folder_of_an_evaluation(self) -> None:
        rows = {"scenario": [SCENARIO, SCENARIO], "tick": [3, 4], "mine_dtd_m": [1234.5, None]}
        with tempfile.TemporaryDirectory() as folder:
            run = Path(folder) / "judged"
            run.mkdir()
            tables = [Path(folder) / "predicted.parquet", Path(folder) / "mine.csv", run / "predictions.parquet"]
            for table in tables:
                frame = pl.DataFrame(rows)
                frame.write_csv(table) if table.suffix == ".csv" else frame.write_parquet(table)
            for source in [tables[0], tables[1], run]:
                found = self.corpus.predictions(source)
                self.assertEqual(found["predicted_dtd_m"].to_list(), [1234.5, None])
                self.assertEqual(found["estimator"].to_list(), ["mine"] * 2)
                self.assertEqual(found["run"].to_list(), [source.name] * 2)
                self.assertEqual(found["weather"].to_list(), ["clear"] * 2)
                self.assertEqual(found["scenario"].to_list(), [SCENARIO] * 2)
            pl.DataFrame({"tick": [3]}).write_parquet(tables[0])
            with self.assertRaisesRegex(CorpusError, "no column scenario, only tick"):
                self.corpus.predictions(tables[0])
            with self.assertRaisesRegex(CorpusError, "none.parquet is missing"):
                self.corpus.predictions(Path(folder) / "none.parquet")
            with self.assertRaisesRegex(CorpusError, "dtd evaluate"):
                self.corpus.predictions(Path(folder))


class Changed(unittest.TestCase):
    """A copy of the corpus that a test changes."""

    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.copy = Path(folder.name) / "corpus"
        shutil.copytree(PATH, self.copy)
        self.scenario = self.copy / "scenarios" / SCENARIO

    def change(self, name: str, change: Callable[[dict[str, Any]], None]) -> None:
        """Changes a JSON file of the scenario."""
        content = json.loads((self.scenario / name).read_text())
        change(content)
        (self.scenario / name).write_text(json.dumps(content))

    def seal(self, name: str) -> None:
        """Writes the hash of a changed file of the scenario into its manifest."""
        manifest = self.scenario / "MANIFEST.b3"
        others = [line for line in manifest.read_text().splitlines() if not line.endswith(f"  {name}")]
        hash_now = blake3((self.scenario / name).read_bytes()).hexdigest()
        manifest.write_text("\n".join([*others, f"{hash_now}  {name}", ""]))

    def add_detections(self, stem: str, model: str) -> None:
        """A table of detections without any, by a model whose hash begins with this."""
        folder = self.scenario / "detections"
        folder.mkdir(exist_ok=True)
        table = folder / f"{stem}.parquet"
        pl.DataFrame({"tick": [], "of": []}, {"tick": pl.UInt32, "of": pl.String}).write_parquet(table)
        record = {"model": model, "model_blake3": stem.ljust(64, "0"), "table_blake3": blake3(table.read_bytes()).hexdigest()}
        (folder / f"{stem}.json").write_text(json.dumps(record))

    def test_columns_belong_to_the_view_with_the_longest_name_that_fits(self) -> None:
        path = self.scenario / "frames.parquet"
        frames = pl.read_parquet(path)
        # Views mast and far_mast: the columns of the second end like those of the first.
        frames = frames.rename({name: name.replace("tower_2", "far_mast") for name in frames.columns})
        frames.with_columns(pts_far_mast=pl.col("pts_far_mast") + 7).write_parquet(path)
        self.seal("frames.parquet")
        self.change("scenario.json", lambda record: record.update(views=["lens", "mast", "far_mast"]))
        corpus = Corpus(self.copy)
        views = corpus.views().filter(scenario=SCENARIO)
        self.assertEqual(views.columns, Corpus(PATH).views().columns)
        self.assertEqual(views.filter(tick=1).select("view", "pts").rows(), [("lens", 1001), ("mast", 1001), ("far_mast", 1008)])
        self.assertEqual(corpus.ticks().columns, Corpus(PATH).ticks().columns)

    def test_aircraft_are_those_of_scenarios_with_traffic(self) -> None:
        self.assertEqual(len(Corpus(self.copy).aircraft()), 0)
        table = pl.DataFrame({"tick": [0, 0], "aircraft_number": [0, 1], "dtd_m": [900.0, None]})
        table.write_parquet(self.scenario / "aircraft.parquet")
        self.seal("aircraft.parquet")
        self.assertEqual(Corpus(self.copy).aircraft().rows(), [(SCENARIO, 0, 0, 900.0), (SCENARIO, 0, 1, None)])

    def test_a_scenario_under_another_weather_than_planned_says_what_differs(self) -> None:
        effective = {"visibility_m": 500, "rain_ratio": None, "differing": ["visibility"]}
        self.change("scenario.json", lambda record: record.update(effective_weather=effective))
        row = Corpus(self.copy).scenarios().filter(scenario=SCENARIO).row(0, named=True)
        self.assertEqual((row["effective_visibility_m"], row["weather_differs"]), (500.0, ["visibility"]))
        # A simulator that reports no weather.
        self.change("scenario.json", lambda record: record.pop("effective_weather"))
        row = Corpus(self.copy).scenarios().filter(scenario=SCENARIO).row(0, named=True)
        self.assertEqual((row["effective_visibility_m"], row["weather_differs"]), (None, []))

    def test_a_model_is_named_by_the_start_of_its_hash(self) -> None:
        self.add_detections("fe8fd7ba3fcd0ea9", "aircraft.onnx")
        corpus = Corpus(self.copy)
        for model in [None, "aircraft.onnx", "aircraft", "fe8f", "fe8fd7ba3fcd0ea9", "fe8fd7ba3fcd0ea900"]:
            self.assertEqual(corpus.detections(model).columns, ["scenario", "tick", "of"], model)
        with self.assertRaisesRegex(CorpusError, r"no detections of model fe9, only of aircraft\.onnx \(fe8f"):
            corpus.detections("fe9")
        self.add_detections("fe80000000000000", "other.onnx")
        with self.assertRaisesRegex(CorpusError, r"'fe8' may mean; choose one: .*\(fe80000000000000\), .*\(fe8fd7ba3fcd0ea9\)"):
            corpus.detections("fe8")
        self.assertEqual(len(corpus.detections("fe8f")), 0)

    def test_a_damaged_file_is_named_with_what_to_do(self) -> None:
        corpus = Corpus(self.copy)
        for name, read in {
            "frames.parquet": corpus.ticks,
            "boxes_truth.parquet": corpus.boxes,
            "views/mast.mp4": lambda: corpus.frame(SCENARIO, "mast", 0),
        }.items():
            path = self.scenario / name
            whole = path.read_bytes()
            path.write_bytes(whole[: len(whole) // 2])
            with self.assertRaisesRegex(CorpusError, f"{path}.*dtd verify", msg=name):
                read()
            path.write_bytes(whole)

    def test_a_table_with_a_single_other_bit_is_named_too(self) -> None:
        for name in ("frames.parquet", "boxes_truth.parquet"):
            path = self.scenario / name
            content = bytearray(path.read_bytes())
            content[len(content) // 2] ^= 1
            path.write_bytes(content)
            with self.assertRaisesRegex(CorpusError, f"{path}.*dtd verify"):
                _ = Corpus(self.copy).ticks() if name == "frames.parquet" else Corpus(self.copy).boxes()

    def test_pictures_of_another_size_than_the_calibration_are_rejected(self) -> None:
        def widen(calibration: dict[str, Any]) -> None:
            calibration["cameras"]["mast"]["width_px"] += 2

        self.change("calibration.json", widen)
        with self.assertRaisesRegex(CorpusError, "mast.mp4 .* it has images of .* px, the calibration"):
            Corpus(self.copy).frame(SCENARIO, "mast", 0)

    def test_links_are_rejected(self) -> None:
        corpus = Corpus(self.copy)
        for name, read in {
            "frames.parquet": corpus.ticks,
            "views/mast.mp4": lambda: corpus.frame(SCENARIO, "mast", 0),
            "views": lambda: corpus.frame(SCENARIO, "mast", 0),
        }.items():
            path = self.scenario / name
            path.rename(self.copy / "elsewhere")
            path.symlink_to(self.copy / "elsewhere")
            with self.assertRaisesRegex(CorpusError, f"{path} is a symbolic link", msg=name):
                read()
            path.unlink()
            (self.copy / "elsewhere").rename(path)

    def test_sealed_boxes_that_are_gone_are_no_missing_labels(self) -> None:
        (self.scenario / "boxes_truth.parquet").unlink()
        with self.assertRaisesRegex(CorpusError, f"{SCENARIO}/boxes_truth.parquet is missing"):
            Corpus(self.copy).boxes()
        manifest = self.scenario / "MANIFEST.b3"
        lines = manifest.read_text().splitlines(keepends=True)
        manifest.write_text("".join(line for line in lines if "boxes_truth" not in line))
        self.assertNotIn(SCENARIO, Corpus(self.copy).boxes()["scenario"].to_list())


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

    def test_a_forked_process_leaves_the_videos_of_its_parent_alone(self) -> None:
        source = self.corpus.video_source(SCENARIO, "mast")
        # Only the collection finds the third.
        videos = [Video(*source), Video(*source, is_threaded=False), Video(*source)]
        first = [video[0] for video in videos]
        lost: list[Any] = [videos.pop()]
        lost.append(lost)
        gc.disable()
        try:
            del lost
            worker = multiprocessing.get_context("fork").Process(target=let_go_of, args=(videos,))
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", DeprecationWarning)
                worker.start()
            worker.join(timeout=30)
            ended = worker.exitcode
            worker.kill()
        finally:
            gc.enable()
        self.assertEqual(ended, 0)
        np.testing.assert_array_equal(videos[0][0], first[0])

    def test_a_process_that_was_forked_without_multiprocessing_ends(self) -> None:
        script = (
            "import os, sys\n"
            "from dtd import Corpus\n"
            f"video = Corpus({str(PATH)!r}).video({SCENARIO!r}, 'mast')\n"
            "video[0]\n"
            "child = os.fork()\n"
            "if child: sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))\n"
        )
        subprocess.run([sys.executable, "-W", "ignore::DeprecationWarning", "-c", script], check=True, timeout=60)

    def test_a_video_that_is_dropped_closed_or_refused_leaves_nothing(self) -> None:
        source = self.corpus.video_source(SCENARIO, "mast")
        gc.disable()
        try:
            before = threads(), len(os.listdir("/proc/self/fd"))
            for is_threaded in (True, False):
                video = Video(*source, is_threaded=is_threaded)
                video[0]
                self.assertEqual(threads() > before[0], is_threaded)
                del video
                video = Video(*source, is_threaded=is_threaded)
                video[0]
                video.close()
                video.close()
                with self.assertRaisesRegex(CorpusError, "is closed"):
                    video[1]
                with self.assertRaisesRegex(CorpusError, "has images of"):
                    Video(*source[:3], (1, 1))
                self.assertEqual((threads(), len(os.listdir("/proc/self/fd"))), before)
        finally:
            gc.enable()

    def test_a_playlist_in_the_place_of_a_video_is_refused(self) -> None:
        path, timestamps, unit, size_px = self.corpus.video_source(SCENARIO, "mast")
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "other.mp4").symlink_to(path)
            playlist = Path(folder) / "mast.mp4"
            playlist.write_text("ffconcat version 1.0\nfile other.mp4\n")
            with av.open(str(playlist)) as followed:
                self.assertEqual(followed.format.name, "concat")
            with self.assertRaisesRegex(CorpusError, "playlists are not followed"):
                Video(playlist, timestamps, unit, size_px)

    def test_a_video_that_counts_in_another_unit_has_the_same_picture_at_the_same_time(self) -> None:
        path, timestamps, unit, _ = self.corpus.video_source(SCENARIO, "mast")
        with tempfile.TemporaryDirectory() as folder:
            for scale, can_tell in [(60_000, True), (30_000, True), (1_000, False)]:
                copy = Path(folder) / f"{scale}.mp4"
                with av.open(str(path)) as video, av.open(str(copy), "w", options={"video_track_timescale": str(scale)}) as other:
                    stream = other.add_stream_from_template(video.streams.video[0])
                    stream.time_base = Fraction(1, scale)
                    for packet in video.demux(video=0):
                        if packet.dts is not None:
                            packet.stream = stream
                            other.mux(packet)
                if not can_tell:
                    with self.assertRaisesRegex(CorpusError, "cannot express the times of the ticks"):
                        Video(copy, timestamps, unit)
                    continue
                with Video(copy, timestamps, unit) as video:
                    for tick in [EXPECTED["tick"], 0]:
                        np.testing.assert_array_equal(video[tick], self.corpus.frame(SCENARIO, "mast", tick))


if __name__ == "__main__":
    unittest.main()
