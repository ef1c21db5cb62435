"""Pictures with their labels as a dataset of PyTorch: needs `pip install dtd-corpus[torch]`."""

from pathlib import Path
from typing import TypedDict

import numpy as np
import polars as pl
import torch
from torch.utils.data import Dataset

from dtd.corpus import Corpus
from dtd.video import Video


class Sample(TypedDict):
    """One picture with an aircraft in it."""

    picture: torch.Tensor
    """`[3, height, width]`, 8 bits."""
    box_px: torch.Tensor
    """Centre right, centre down, width, height of the true box."""
    dtd_m: float
    scenario: str
    view: str
    tick: int


class Pictures(Dataset[Sample]):
    """The pictures of a corpus that show the aircraft, in order: shuffle them by blocks, since a jump costs a key-frame interval."""

    def __init__(self, corpus: Corpus | str | Path, side: str | None = None, every: int = 1) -> None:
        """`side`: `train`, `validation` or `test`, all by default; `every`: take each n-th tick."""
        self._corpus = corpus if isinstance(corpus, Corpus) else Corpus(corpus)
        rows = self._corpus.boxes().join(self._corpus.ticks().select("scenario", "tick", "dtd_m"), on=["scenario", "tick"])
        if side is not None:
            sides = self._corpus.scenarios().filter(pl.col("side") == side)
            rows = rows.join(sides.select("scenario"), on="scenario", how="semi")
        self._rows = rows.filter(pl.col("tick") % every == 0).sort("scenario", "view", "tick")
        self._open: tuple[str, str, Video] | None = None

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: int) -> Sample:
        row = self._rows.row(index, named=True)
        picture = np.ascontiguousarray(self._video(row["scenario"], row["view"])[row["tick"]].transpose(2, 0, 1))
        box = [row[name] for name in ("cx_px", "cy_px", "width_px", "height_px")]
        return Sample(
            picture=torch.from_numpy(picture),
            box_px=torch.tensor(box, dtype=torch.float64),
            dtd_m=row["dtd_m"],
            scenario=row["scenario"],
            view=row["view"],
            tick=row["tick"],
        )

    def _video(self, scenario: str, view: str) -> Video:
        """One open video is enough: samples are in order."""
        if self._open is None or self._open[:2] != (scenario, view):
            if self._open is not None:
                self._open[2].close()
            self._open = (scenario, view, self._corpus.video(scenario, view))
        return self._open[2]

    def __getstate__(self) -> dict[str, object]:
        """Workers open videos of their own."""
        return {**self.__dict__, "_open": None}
