#!/usr/bin/env python3
"""Regenerates `check_pattern.json` of this folder: `python3 xplane-bridge/golden/check_pattern.py`.

The check pattern of `docs/capture-link.md`, as rectangles to be filled one after the other. Written from the description and not
from the Rust code that it tests.
"""

import binascii
import json
import pathlib

COLUMNS, ROWS = 8, 6
MAGENTA, BLACK, WHITE = [255, 0, 255], [0, 0, 0], [255, 255, 255]


def fill(left, top, right, bottom, rgb):
    return {"left_px": left, "top_px": top, "right_px": right, "bottom_px": bottom, "rgb": rgb}


def check_pattern(code, width, height):
    """The rectangles of a code's pattern in a window of this size; right and bottom are just outside."""
    border = max(2, min(width, height) // 32)
    rectangles = [
        fill(0, 0, width, height, MAGENTA),
        fill(border, border, width - border, height - border, BLACK),
    ]
    grid_width, grid_height = width - 4 * border, height - 4 * border
    checksum = binascii.crc_hqx(code.to_bytes(4, "big"), 0xFFFF)
    bits = f"{code:032b}{checksum:016b}"
    for at, bit in enumerate(bits):
        row, column = divmod(at, COLUMNS)
        if bit == "1":
            rectangles.append(fill(
                2 * border + grid_width * column // COLUMNS,
                2 * border + grid_height * row // ROWS,
                2 * border + grid_width * (column + 1) // COLUMNS,
                2 * border + grid_height * (row + 1) // ROWS,
                WHITE,
            ))
    return rectangles


SAMPLES = [(0x12345678, 64, 48), (0xDEADBEEF, 101, 77), (0, 320, 240), (0xFFFFFFFF, 1920, 1280)]
golden = {
    "about": "rectangles that make the check pattern of a code, to be filled in this order",
    "direction": "screen",
    "patterns": [
        {"code": code, "width_px": width, "height_px": height, "fill": check_pattern(code, width, height)}
        for code, width, height in SAMPLES
    ],
}
# One rectangle a line.
text = json.dumps(golden).replace('{"left_px"', '\n  {"left_px"').replace('{"code"', '\n {"code"') + "\n"
(pathlib.Path(__file__).parent / "check_pattern.json").write_text(text)
