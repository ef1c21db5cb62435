"""The ticks of a corpus as samples to learn from, in the form that `torch.utils.data.DataLoader` takes.

    from dtd import Corpus
    from dtd.tick_dataset import TickDataset

    train = TickDataset(Corpus("corpus"), side="train", crop_px=(96, 64))
    train[0]["pictures"]["left"]      # 64 x 96 x 3, RGB

Reading in order decodes each picture once; for training in a shuffled order, see `dtd.shuffled_ticks`.

Where torch is installed, `TickDataset` is a `torch.utils.data.Dataset`; without torch it is the same sequence of NumPy arrays. Workers of a
`DataLoader`, forked or spawned, each open the videos on their own.
"""

import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypedDict

import numpy as np
import numpy.typing as npt
import polars as pl

from dtd.corpus import Corpus
from dtd.files import CorpusError
from dtd.video import Picture, Video

if TYPE_CHECKING:
    _Dataset = object
else:
    try:
        from torch.utils.data import Dataset as _Dataset
    except ImportError:
        _Dataset = object

Floats = npt.NDArray[np.float64]
_BOX = ["cx_px", "cy_px", "width_px", "height_px"]


class Sample(TypedDict):
    """What is known of a tick. Images, boxes and corners are by view."""

    scenario: str
    tick: int
    time_ns: int
    """Time since tick 0."""
    dtd_m: float
    """Distance to touchdown; NaN without labels."""
    pictures: dict[str, Picture]
    """Height x width x 3, RGB, 8 bits: whole images, or crops."""
    boxes: dict[str, Floats]
    """Centre right, centre down, width, height in pixels of the whole image; NaN where there is no box."""
    corners_px: dict[str, npt.NDArray[np.int64]]
    """Right and down: the place of the crop's top-left pixel in the whole image."""


class Run(NamedTuple):
    """Samples of a scenario in their order."""

    scenario: str
    samples: list[int]
    """Their numbers in the dataset."""


class TickDataset(_Dataset):
    """A sample per tick."""

    def __init__(
        self,
        corpus: Corpus,
        *,
        side: str | None = None,
        scenarios: Sequence[str] | None = None,
        views: Sequence[str] | None = None,
        every: int = 1,
        boxes: pl.DataFrame | None = None,
        crop_px: tuple[int, int] | None = None,
        transform: Callable[[Sample], Any] | None = None,
        open_videos: int = 8,
    ) -> None:
        """The ticks of these scenarios (all, or one side of the split).

        Scenarios whose weather differed from the plan are included; `dtd train` leaves them out.

        `views`: those of the first scenario, if not given; every scenario must have them.
        `every`: every n-th tick.
        `boxes`: a table with scenario, tick, view and box, such as the best of `corpus.detections()`; the true ones, if not given.
        `crop_px`: width and height of crops around the boxes, moved into the image where they would leave it; ticks without a box
        in each view are left out.
        `transform`: what is made of a sample before it is returned.
        `open_videos`: most videos that are open at once, in each worker.
        """
        if every < 1 or (crop_px is not None and min(crop_px) < 1):
            raise ValueError(f"every={every} and the sides of crop_px={crop_px} must be 1 or more")
        chosen = corpus.scenarios()
        if side is not None:
            chosen = chosen.filter(side=side)
        if scenarios is not None:
            for scenario in scenarios:
                corpus.record(scenario)
            chosen = chosen.filter(pl.col("scenario").is_in(list(scenarios)))
        ids = chosen["scenario"].to_list()
        if not ids:
            raise CorpusError(f"{corpus.path} has no scenario with side {side!r} among {list(scenarios) if scenarios is not None else 'all'}")
        self.views = list(views if views is not None else corpus.views_of(ids[0]))
        if not self.views:
            raise ValueError("views is empty: name at least one, or leave it out for all")
        self.crop_px = crop_px
        self.transform = transform
        self._open_videos = open_videos
        # Everything is kept as arrays: the threads of polars do not survive a fork.
        self._sources = {(one, view): corpus.video_source(one, view) for one in ids for view in self.views}
        ticks = corpus.ticks()
        if "dtd_m" not in ticks.columns:
            ticks = ticks.with_columns(dtd_m=pl.lit(None, pl.Float64))
        rows = ticks.filter(pl.col("scenario").is_in(ids), pl.col("tick") % every == 0)
        table = corpus.boxes() if boxes is None else boxes
        if "aircraft_number" in table.columns:
            # Distances belong to the first aircraft.
            table = table.filter(pl.col("aircraft_number").fill_null(0) == 0)
        for view in self.views:
            names = {name: f"{view} {name}" for name in _BOX}
            of_view = table.filter(view=view).select("scenario", "tick", pl.col(_BOX).fill_nan(None)).rename(names)
            rows = rows.join(of_view, on=["scenario", "tick"], how="left", validate="m:1", maintain_order="left")
        if crop_px is not None:
            rows = rows.drop_nulls([f"{view} {name}" for view in self.views for name in _BOX])
            if rows.is_empty():
                raise CorpusError(f"no tick has a box in each of the views {', '.join(self.views)}, around which crops could be cut")
        self._scenarios = rows["scenario"].to_list()
        self._ticks = rows["tick"].to_numpy()
        self._times_ns = rows["time_ns"].to_numpy()
        self._dtd_m = rows["dtd_m"].cast(pl.Float64).fill_null(float("nan")).to_numpy()
        self._boxes = {
            view: rows.select(pl.col(f"{view} {name}").fill_null(float("nan")) for name in _BOX).to_numpy()
            for view in self.views
        }
        self._forget_videos()

    def __len__(self) -> int:
        """Number of samples."""
        return len(self._scenarios)

    def __getitem__(self, index: int) -> Any:
        """The sample with this number: a `Sample`, or what `transform` makes of it."""
        if self._process != os.getpid():
            # Forked: these videos are the parent's.
            self._forget_videos()
        with self._lock:
            sample = self.sample(index, self._video)
        return self.transformed(sample)

    def transformed(self, sample: Sample) -> Any:
        """What `transform` makes of a sample."""
        return sample if self.transform is None else self.transform(sample)

    def sample(self, index: int, video: Callable[[str, str], Video]) -> Sample:
        """The sample with this number as it is, read from the videos that `video` gives for scenario and view."""
        if not 0 <= index < len(self):
            raise IndexError(f"there are the samples 0 to {len(self) - 1}, not {index}")
        scenario, tick = self._scenarios[index], int(self._ticks[index])
        boxes = {view: self._boxes[view][index].copy() for view in self.views}
        pictures, corners = {}, {}
        for view in self.views:
            picture = video(scenario, view)[tick]
            corners[view] = np.zeros(2, np.int64) if self.crop_px is None else self._corner(boxes[view], picture, f"{scenario}, view {view}")
            pictures[view] = self._cropped(picture, corners[view])
        return Sample(
            scenario=scenario,
            tick=tick,
            time_ns=int(self._times_ns[index]),
            dtd_m=float(self._dtd_m[index]),
            pictures=pictures,
            boxes=boxes,
            corners_px=corners,
        )

    @property
    def sample_bytes(self) -> int:
        """Most bytes that the images of a sample have."""
        if self.crop_px is not None:
            return 3 * self.crop_px[0] * self.crop_px[1] * len(self.views)
        return len(self.views) * max(3 * width * height for _, _, _, (width, height) in self._sources.values())

    def runs(self, ticks: int) -> list[Run]:
        """All samples in runs of at most so many ticks, each of which begins at a multiple of it."""
        runs: dict[tuple[str, int], Run] = {}
        for index, (scenario, tick) in enumerate(zip(self._scenarios, self._ticks.tolist(), strict=True)):
            runs.setdefault((scenario, tick // ticks), Run(scenario, [])).samples.append(index)
        return list(runs.values())

    def open_video(self, scenario: str, view: str, *, is_threaded: bool = True) -> Video:
        """The images of a view of a scenario of this dataset; to be closed by the caller."""
        return Video(*self._sources[scenario, view], is_threaded=is_threaded)

    def _corner(self, box: Floats, picture: Picture, where: str) -> npt.NDArray[np.int64]:
        assert self.crop_px is not None
        room = np.array([picture.shape[1] - self.crop_px[0], picture.shape[0] - self.crop_px[1]])
        if (room < 0).any():
            raise CorpusError(f"{where}: a crop of {self.crop_px} does not fit into an image of {picture.shape[1::-1]} pixels")
        corner = np.round(box[:2] - (np.array(self.crop_px) - 1) / 2)
        return np.clip(corner, 0, room).astype(np.int64)

    def _cropped(self, picture: Picture, corner: npt.NDArray[np.int64]) -> Picture:
        if self.crop_px is None:
            return picture
        (right, down), (width, height) = corner, self.crop_px
        return picture[down : down + height, right : right + width].copy()

    def _video(self, scenario: str, view: str) -> Video:
        key = (scenario, view)
        if key not in self._videos:
            while len(self._videos) >= max(self._open_videos, 1):
                self._videos.popitem(last=False)[1].close()
            self._videos[key] = self.open_video(scenario, view)
        self._videos.move_to_end(key)
        return self._videos[key]

    def _forget_videos(self) -> None:
        self._process = os.getpid()
        self._lock = threading.Lock()
        self._videos: OrderedDict[tuple[str, str], Video] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        """Everything but open videos."""
        left_out = ("_videos", "_lock", "_process")
        return {name: value for name, value in self.__dict__.items() if name not in left_out}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Videos are opened when they are needed."""
        self.__dict__.update(state)
        self._forget_videos()
