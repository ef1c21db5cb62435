#!/usr/bin/env python3
"""Draws weathers-NMnm.jpg: every weather (rows) and time (columns) of a labelled corpus at a distance to touchdown, with the aircraft in a corner.

    PYTHONPATH=python .venv/bin/python docs/images/weathers.py CORPUS 6        (nautical miles)

The corpus is scenarios.toml's, recorded at a low rate: its `[picture]` with `frame_rate = "1/10"`.
"""

import pathlib
import sys

import polars as pl
from PIL import Image

from dtd import Corpus

# Of an image in the sheet, and of its inset; the surroundings of the aircraft that the inset shows, pixels.
CELL, INSET, SHOWN = (640, 427), (256, 154), (80, 48)
METRES_PER_NM = 1852.0


def cell(corpus, scenario, distance_m):
    view = corpus.views_of(scenario)[0]
    ticks = corpus.ticks().filter(pl.col("scenario") == scenario)
    tick = ticks.sort((pl.col("dtd_m") - distance_m).abs())["tick"][0]
    picture = Image.fromarray(corpus.frame(scenario, view, tick))
    at = (pl.col("scenario") == scenario) & (pl.col("tick") == tick) & (pl.col("view") == view)
    drawn = picture.resize(CELL, Image.Resampling.LANCZOS)
    for box in corpus.boxes().filter(at).iter_rows(named=True):
        left, top = box["cx_px"] - SHOWN[0] / 2, box["cy_px"] - SHOWN[1] / 2
        around = [left, top, left + SHOWN[0], top + SHOWN[1]]
        drawn.paste((255, 255, 255), [0, 0, INSET[0] + 2, INSET[1] + 2])
        drawn.paste(picture.resize(INSET, Image.Resampling.NEAREST, box=around), (0, 0))
    return drawn


def main():
    corpus, distance_nm = Corpus(sys.argv[1]), float(sys.argv[2])
    first = corpus.scenarios().unique(["weather", "time_of_day"], keep="first").sort("weather", "time_of_day")
    weathers, times = (sorted(first[name].unique()) for name in ("weather", "time_of_day"))
    sheet = Image.new("RGB", (len(times) * CELL[0], len(weathers) * CELL[1]))
    for row in first.iter_rows(named=True):
        place = (times.index(row["time_of_day"]) * CELL[0], weathers.index(row["weather"]) * CELL[1])
        sheet.paste(cell(corpus, row["scenario"], distance_nm * METRES_PER_NM), place)
    sheet.save(pathlib.Path(__file__).with_name(f"weathers-{distance_nm:g}nm.jpg"), quality=88)


if __name__ == "__main__":
    main()
