"""The frame code of docs/capture-link.md: a drawn frame's number, in the window's margins around the image. Pure."""

from __future__ import annotations

import binascii
from typing import Iterator

from .check_pattern import BLACK, WHITE, Rectangle

# Height of the two strips and width of the column, which is the smallest margin.
MARGIN_PX = 16
# A strip's cells: the code and its checksum.
CELLS = 48
# The column's bars, from the left: a white and a black one to compare with, the number's lowest bits, and a black one.
COLUMN_BITS = 5
COLUMN_BARS = COLUMN_BITS + 3
NUMBERS = 1 << 24
MOST_STEADY = 7


def code_of(number: int, steady: int, probe: bool, view: int) -> int:
    """The 32 bits of a frame: its number, how many frames before it are known, whether it shows a probe, and its view."""
    return (number % NUMBERS) << 8 | min(steady, MOST_STEADY) << 5 | int(probe) << 4 | view % 16


def rectangles(code: int, width: int, height: int, margin_x: int, margin_y: int) -> Iterator[Rectangle]:
    """The rectangles to fill, in this order, in a window of this size around an image with these margins."""
    left, right = margin_x - MARGIN_PX, width - margin_x + MARGIN_PX
    top, bottom = margin_y, height - margin_y
    bits = code << 16 | binascii.crc_hqx(code.to_bytes(4, "big"), 0xFFFF)
    across = right - left
    for strip_top in (top - MARGIN_PX, bottom):
        yield left, strip_top, right, strip_top + MARGIN_PX, BLACK
        for begin, end in _runs(bits, CELLS):
            yield left + across * begin // CELLS, strip_top, left + across * end // CELLS, strip_top + MARGIN_PX, WHITE
    yield left, top, left + MARGIN_PX, bottom, BLACK
    number = code >> 8 & (1 << COLUMN_BITS) - 1
    bars = 1 << COLUMN_BARS - 1 | number << 1
    for begin, end in _runs(bars, COLUMN_BARS):
        yield left + MARGIN_PX * begin // COLUMN_BARS, top, left + MARGIN_PX * end // COLUMN_BARS, bottom, WHITE


def _runs(bits: int, count: int) -> Iterator[tuple[int, int]]:
    """The runs of set bits, the highest bit first."""
    begin: int | None = None
    for at in range(count + 1):
        is_set = at < count and bits >> (count - 1 - at) & 1 == 1
        if is_set and begin is None:
            begin = at
        elif not is_set and begin is not None:
            yield begin, at
            begin = None
