"""The check pattern of docs/capture-link.md as rectangles to be filled. Pure."""

from __future__ import annotations

import binascii
from typing import Iterator

Rgb = tuple[int, int, int]
# left, top, right, bottom in pixels from the top left (right and bottom are one beyond), and the colour.
Rectangle = tuple[int, int, int, int, Rgb]

MAGENTA: Rgb = (255, 0, 255)
BLACK: Rgb = (0, 0, 0)
WHITE: Rgb = (255, 255, 255)
COLUMNS, ROWS = 8, 6


def rectangles(code: int, width: int, height: int) -> Iterator[Rectangle]:
    """The rectangles to fill, in this order, in a window of this size."""
    border = max(2, min(width, height) // 32)
    yield 0, 0, width, height, MAGENTA
    yield border, border, width - border, height - border, BLACK
    checksum = binascii.crc_hqx(code.to_bytes(4, "big"), 0xFFFF)
    bits = code << 16 | checksum
    margin = 2 * border
    grid_width, grid_height = width - 2 * margin, height - 2 * margin
    for cell in range(COLUMNS * ROWS):
        if bits >> (COLUMNS * ROWS - 1 - cell) & 1:
            row, column = divmod(cell, COLUMNS)
            yield (
                margin + grid_width * column // COLUMNS,
                margin + grid_height * row // ROWS,
                margin + grid_width * (column + 1) // COLUMNS,
                margin + grid_height * (row + 1) // ROWS,
                WHITE,
            )
