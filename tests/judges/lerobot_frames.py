"""A LeRobot dataset as its own library returns it, or as the published layout says it is to be read, next to the corpus it was made from.

Usage: python lerobot_frames.py lerobot|layout FOLDER CORPUS STEP    every STEP-th frame; prints JSON

`lerobot` needs the library, which brings torch. `layout` reads the files with pyarrow, pandas and PyAV alone, and checks indices,
statistics, types and splits besides. Both print, for each frame, its state by name and which of the corpus's images, among those near its
tick, each of its images resembles most.
"""

import json
import os
import sys
import tempfile
from functools import cache
from pathlib import Path

home = tempfile.TemporaryDirectory()
os.environ.update(HF_HOME=home.name, HF_HUB_OFFLINE="1", HF_DATASETS_OFFLINE="1")

import av  # noqa: E402
import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
import pyarrow.parquet as pq  # noqa: E402
from av.video.reformatter import Colorspace  # noqa: E402

NEIGHBOURS = 3
WITHIN_S = 1e-4


def decoded(path):
    """All images of a video by time in seconds."""
    with av.open(str(path)) as video:
        # The videos are BT.709 and say so; FFmpeg's converter has to be told.
        return [
            (frame.time, frame.reformat(format="rgb24", src_colorspace=Colorspace.ITU709).to_ndarray())
            for frame in video.decode(video=0)
        ]


class Layout:
    """The published layout: info.json says where everything is, the episodes say which rows and which times of which files are theirs."""

    def __init__(self, folder):
        self.folder = folder
        self.info = json.loads((folder / "meta/info.json").read_text())
        assert self.info["codebase_version"] == "v3.0" and isinstance(self.info["fps"], int)
        self.features = self.info["features"]
        self.video_keys = [name for name, kind in self.features.items() if kind["dtype"] == "video"]
        self.episodes = pd.concat(map(pd.read_parquet, sorted(folder.glob("meta/episodes/*/*.parquet"))))
        self.tasks = pd.read_parquet(folder / "meta/tasks.parquet")
        self.rows = pd.concat(self._of_file(path) for path in sorted(folder.glob("data/*/*.parquet")))
        self._check_indices()
        self._check_stats()

    def _of_file(self, path):
        table = pq.read_table(path)
        for name, kind in self.features.items():
            if kind["dtype"] != "video":
                (count,), found = kind["shape"], table.schema.field(name).type
                expected = {"float32": "float", "float64": "double", "int64": "int64"}[kind["dtype"]]
                inner = found.value_type if count > 1 else found
                assert str(inner) == expected, f"{name} holds {found}, info.json says {kind}"
                assert count == 1 or found.list_size == count == len(kind["names"])
        assert set(table.column_names) | set(self.video_keys) == set(self.features)
        return table.to_pandas()

    def _check_indices(self):
        episodes, rows, info = self.episodes, self.rows, self.info
        assert list(rows["index"]) == list(range(info["total_frames"]))
        assert list(episodes["episode_index"]) == list(range(info["total_episodes"]))
        begin = 0
        for number, episode in enumerate(episodes.to_dict("records")):
            length = episode["length"]
            assert (episode["dataset_from_index"], episode["dataset_to_index"]) == (begin, begin + length)
            mine = rows[begin : begin + length]
            path = self.path("data_path", episode, "data")
            assert number in set(pq.read_table(path)["episode_index"].to_pylist())
            assert (mine["episode_index"] == number).all()
            assert list(mine["frame_index"]) == list(range(length))
            np.testing.assert_array_equal(mine["timestamp"], (np.arange(length) / info["fps"]).astype("float32"))
            assert [self.tasks.iloc[task].name for task in mine["task_index"].unique()] == list(episode["tasks"])
            for key in self.video_keys:
                lasts = episode[f"videos/{key}/to_timestamp"] - episode[f"videos/{key}/from_timestamp"]
                assert abs(lasts * info["fps"] - length) < 1e-6
            begin += length
        sides = [range(*map(int, text.split(":"))) for text in info["splits"].values()]
        assert sorted(number for side in sides for number in side) == list(range(info["total_episodes"]))
        for name, text in info["splits"].items():
            begin, end = map(int, text.split(":"))
            assert set(episodes["split"][begin:end]) == {name}

    def _check_stats(self):
        stats = json.loads((self.folder / "meta/stats.json").read_text())
        assert set(stats) == set(self.features)
        for name, found in stats.items():
            if name in self.video_keys:
                # A sample of the pictures was counted: between their extremes, near their mean.
                paths = sorted(self.folder.glob(f"videos/{name}/*/*"))
                pictures = np.stack([picture for path in paths for _, picture in decoded(path)]) / 255
                colour = pictures.mean(axis=(0, 1, 2))
                assert np.shape(found["mean"]) == (3, 1, 1) and 0 < found["count"][0] <= len(pictures)
                np.testing.assert_allclose(np.ravel(found["mean"]), colour, atol=0.03)
                np.testing.assert_allclose(np.ravel(found["std"]), pictures.std(axis=(0, 1, 2)), atol=0.03)
                assert 0 <= np.min(found["min"]) < np.min(colour) and np.max(colour) < np.max(found["max"]) <= 1
                continue
            values = np.stack(self.rows[name].to_numpy()).reshape(len(self.rows), -1).astype(float)
            assert found["count"] == [len(values)]
            for word, expected in (("min", values.min(0)), ("max", values.max(0)), ("mean", values.mean(0)), ("std", values.std(0))):
                np.testing.assert_allclose(found[word], expected, rtol=1e-7, atol=1e-9, err_msg=f"{name} {word}")

    def path(self, template, episode, prefix, **more):
        numbers = {name: episode[f"{prefix}/{name}"] for name in ("chunk_index", "file_index")}
        return self.folder / self.info[template].format(**numbers, **more)

    @cache
    def _video(self, path):
        return decoded(path)

    def __getitem__(self, index):
        row = self.rows.iloc[index].to_dict()
        episode = self.episodes.iloc[row["episode_index"]].to_dict()
        for key in self.video_keys:
            wanted = row["frame_index"] / self.info["fps"] + episode[f"videos/{key}/from_timestamp"]
            pictures = self._video(self.path("video_path", episode, f"videos/{key}", video_key=key))
            time, picture = min(pictures, key=lambda one: abs(one[0] - wanted))
            assert abs(time - wanted) < WITHIN_S, f"{key} has no image at {wanted} s, the nearest is at {time} s"
            row[key] = picture
        return row


class Library:
    """The library itself."""

    def __init__(self, folder):
        from lerobot.datasets.lerobot_dataset import LeRobotDataset

        # FFmpeg by way of torchvision: its other way needs a torchvision newer than Debian's.
        self.dataset = LeRobotDataset("dtd/corpus", root=folder, video_backend="video_reader")
        self.features = self.dataset.meta.features
        self.video_keys = self.dataset.meta.video_keys
        self.info = {"fps": self.dataset.fps, "total_frames": len(self.dataset)}
        self.episodes = self.dataset.meta.episodes.to_pandas()

    def __getitem__(self, index):
        item = self.dataset[index]
        row = {name: item[name].numpy() for name in self.features if name not in self.video_keys}
        for key in self.video_keys:
            # Channels first, from 0 to 1.
            row[key] = (item[key].permute(1, 2, 0).numpy() * 255).round()
        assert item["task"] == self.dataset.meta.episodes[int(row["episode_index"])]["tasks"][0]
        return row


@cache
def recorded(corpus, scenario, view):
    (path,) = (corpus / "scenarios" / scenario / "views").glob(f"{view}.*")
    return [picture for _, picture in decoded(path)]


def resembled(picture, pictures, tick):
    """The tick near this one whose image differs least where these images differ, and by how many levels this one's does on average."""
    near = range(max(tick - NEIGHBOURS, 0), min(tick + NEIGHBOURS + 1, len(pictures)))
    all_near = np.stack([pictures[other] for other in near]).astype(float)
    apart = abs(all_near - picture)
    moving = all_near.max(axis=0) - all_near.min(axis=0)
    of_moving = dict(zip(near, (apart * moving).sum(axis=(1, 2, 3))))
    # Pictures may be equal.
    nearest = min(near, key=lambda other: (of_moving[other], other != tick))
    return nearest, float(apart[tick - near.start].mean())


how, folder, corpus, step = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4])
dataset = {"lerobot": Library, "layout": Layout}[how](folder)
frames = []
for index in range(0, dataset.info["total_frames"], step):
    row = dataset[index]
    tick, scenario = int(row["tick"]), dataset.episodes["scenario"].iloc[int(row["episode_index"])]
    pictures = {}
    for key in dataset.video_keys:
        view = key.removeprefix("observation.images.")
        pictures[view], apart = resembled(row[key], recorded(corpus, scenario, view), tick)
        assert apart < 6, f"{scenario} {view} tick {tick}: {apart} levels from the recorded image"
    state = dict(zip(dataset.features["observation.state"]["names"], map(float, row["observation.state"])))
    times = {"timestamp_s": float(row["timestamp"]), "time_ns": int(row["time_ns"])}
    frames.append({"scenario": scenario, "tick": tick, "state": state, "pictures": pictures} | times)
print(json.dumps({"fps": dataset.info["fps"], "total": dataset.info["total_frames"], "frames": frames}))
