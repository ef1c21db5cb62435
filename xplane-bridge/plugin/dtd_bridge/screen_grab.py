"""The screen of this computer, for a client on another one: its requests, and this system's way to grab. Nothing here calls ``xp``.

X-Plane 12's frame cannot be read back, so images come off the screen, and a client on another computer cannot grab that. A screen is used by
one thread, the one of its connection.
"""

from __future__ import annotations

import sys
from typing import Protocol

from .messages import Refusal, whole
from .wire import MAX_PAYLOAD_BYTES, Header

# A region may be anywhere on a desktop of several monitors.
MAX_SIDE_PX = 65_535


class ScreenError(Exception):
    """Why the screen cannot be grabbed, as a sentence."""


class Screen(Protocol):
    """A desktop, all monitors together, in physical pixels from its top left."""

    def size(self) -> tuple[int, int]:
        """Width and height now; monitors come and go."""

    def grab(self, x: int, y: int, width: int, height: int) -> bytes:
        """A region of it: red, green, blue, row by row from the top left."""

    def close(self) -> None:
        """Releases its resources."""


def no_way_here() -> str | None:
    """Why the plugin cannot grab this system's screen, if it cannot."""
    if sys.platform == "win32" or sys.platform.startswith("linux"):
        return None
    return "the plugin can grab the screen of Windows and of Linux (X11), not of this system: run dtd on X-Plane's computer"


def open_screen() -> Screen:
    """This computer's; ScreenError if it cannot be opened."""
    reason = no_way_here()
    if reason is not None:
        raise ScreenError(reason)
    if sys.platform == "win32":
        from .screen_gdi import open_gdi

        return open_gdi()
    from .screen_x11 import open_x11

    return open_x11()


def answer(screen: Screen, header: Header) -> tuple[Header, bytes]:
    """The answer to a request of a client that watches the screen."""
    try:
        if header["message"] != "grab":
            raise Refusal(f"a connection for the screen knows no message {header['message']!r}, expected grab")
        x, y, width, height = _part(header, *screen.size())
        return {"message": "grabbed", "width_px": width, "height_px": height}, screen.grab(x, y, width, height)
    except (Refusal, ScreenError) as error:
        return {"message": "error", "text": str(error)}, b""


def rgb_of_bgrx(pixels: bytes) -> bytes:
    """Red, green, blue of pixels that have blue, green, red and one byte more."""
    rgb = bytearray(len(pixels) // 4 * 3)
    for to, come_from in enumerate((2, 1, 0)):
        rgb[to::3] = pixels[come_from::4]
    return bytes(rgb)


def _part(header: Header, across: int, down: int) -> tuple[int, int, int, int]:
    """The requested region: left, top, width, height; everything if none is given."""
    keys = ("x_px", "y_px", "width_px", "height_px")
    x, y, width, height = 0, 0, across, down
    if any(key in header for key in keys):
        x, y, width, height = (whole(header, key, int(key in keys[2:]), MAX_SIDE_PX) for key in keys)
    if width * height * 3 > MAX_PAYLOAD_BYTES:
        raise Refusal(f"an image of {width}x{height} pixels is larger than what the link carries: switch monitors off")
    if x + width > across or y + height > down:
        raise Refusal(
            f"{width}x{height} pixels at ({x}, {y}) do not lie on the screen, which has {across}x{down}: did a monitor change?"
        )
    return x, y, width, height
