#!/usr/bin/env python3
"""Draws both-views.jpg: a tick of a demo's corpus in both views, its ground-truth boxes, the true distance, and an estimate.

    PYTHONPATH=python .venv/bin/python docs/images/both_views.py DEMO 1200-cloudy-r1 145        (DEMO of `dtd demo`, a scenario, a tick)
"""

import pathlib
import sys

import matplotlib
import polars as pl
from PIL import Image, ImageDraw, ImageFont

from dtd import Corpus

ESTIMATOR = "inverse_range_filtered"
# Of a view, between views, and of the line of text below them, pixels; rows of a view that are cut off above.
WIDTH, HEIGHT, GAP, STRIP, CUT = 760, 380, 8, 64, 110
INSET, ZOOM = (400, 208), 4
YELLOW, DARK = "#ffd21e", "#161a22"
METRES_PER_NM = 1852.0


def font(size, bold=False):
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(pathlib.Path(matplotlib.get_data_path(), "fonts/ttf", name)), size)


def drawn(picture, box, view):
    """A view's image, and the aircraft in an inset."""
    full = Image.fromarray(picture)
    scale = WIDTH / full.width
    small = full.resize((WIDTH, round(full.height * scale)), Image.Resampling.LANCZOS).crop((0, CUT, WIDTH, CUT + HEIGHT))
    draw = ImageDraw.Draw(small)
    half = [length / ZOOM / 2 for length in INSET]
    centre = [box["cx_px"], box["cy_px"]]
    around = [centre[0] - half[0], centre[1] - half[1], centre[0] + half[0], centre[1] + half[1]]
    x, y = centre[0] * scale, centre[1] * scale - CUT
    # Beside the aircraft, where the view has more room.
    left = 14 if x > WIDTH / 2 else WIDTH - INSET[0] - 14
    place = [left, 14, left + INSET[0], 14 + INSET[1]]
    mark = [x - 12, y - 6, x + 12, y + 6]
    draw.line([place[2], 118, mark[0], y] if left == 14 else [place[0], 118, mark[2], y], fill=YELLOW)
    draw.rectangle(mark, outline=YELLOW, width=2)
    small.paste(full.resize(INSET, Image.Resampling.BICUBIC, box=around), place[:2])
    draw.rectangle(place, outline=YELLOW, width=2)
    width, height = box["width_px"] * ZOOM, box["height_px"] * ZOOM
    x, y = (place[0] + place[2]) / 2, (place[1] + place[3]) / 2
    draw.rectangle([x - width / 2, y - height / 2, x + width / 2, y + height / 2], outline=YELLOW, width=2)
    draw.text((place[0] + 10, place[3] - 28), f"{ZOOM}x, ground-truth box", font=font(16), fill="#202020")
    draw.text((16, 352), f'view "{view}"', font=font(16, True), fill="white", stroke_width=2, stroke_fill="black")
    return small


def main():
    demo, scenario, tick = pathlib.Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    corpus = Corpus(demo / "corpus")
    at = (pl.col("scenario") == scenario) & (pl.col("tick") == tick)
    of_estimator = pl.col("estimator") == ESTIMATOR
    (estimate,) = corpus.predictions(demo / "run").filter(at, of_estimator).iter_rows(named=True)
    views = corpus.views_of(scenario)
    page = Image.new("RGB", (len(views) * (WIDTH + GAP) - GAP, HEIGHT + STRIP), DARK)
    for number, view in enumerate(views):
        (box,) = corpus.boxes().filter(at, pl.col("view") == view).iter_rows(named=True)
        page.paste(drawn(corpus.frame(scenario, view, tick), box, view), (number * (WIDTH + GAP), 0))
    true_m, found_m = estimate["dtd_m"], estimate["predicted_dtd_m"]
    words = (
        f"ground truth: {true_m:,.1f} m to touchdown ({true_m / METRES_PER_NM:.2f} NM)      {ESTIMATOR}: {found_m:,.1f} m"
        f"      error: {found_m - true_m:+.1f} m ({100 * abs(found_m / true_m - 1):.3f} %)"
    )
    middle = (page.width / 2, HEIGHT + STRIP / 2)
    ImageDraw.Draw(page).text(middle, words, font=font(20, True), fill="white", anchor="mm")
    page.save(pathlib.Path(__file__).with_name("both-views.jpg"), quality=88)


if __name__ == "__main__":
    main()
