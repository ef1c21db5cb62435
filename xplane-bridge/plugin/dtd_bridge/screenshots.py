"""Images by X-Plane's own screenshot command: the only way that needs neither OpenGL nor a screen to grab.

X-Plane names the file itself and writes it into ``Output/screenshots`` some tenths of a second later. It takes the camera for it,
so the camera has to be taken back afterwards. That makes it slow: suitable for an image every few seconds of flight.
"""

from __future__ import annotations

import os
import struct
import time
from pathlib import Path
from typing import Callable, Generator

from .log import log
from .messages import Refusal
from .pixels import Frame
from .xp_api import Xp

COMMAND = "sim/operation/screenshot"
# Live clients wait 0.2 or 0.3 s; a large picture on a slow disk takes longer.
FILE_LIMIT_S = 10.0
# Users keep thousands of files in the folder: it is listed when its time of change differs, and otherwise this often, since not every
# file system keeps that time.
LIST_GAP_S = 0.5
MAX_FILE_BYTES = 192 << 20
SIGNATURE = b"\x89PNG\r\n\x1a\n"
END = b"\0\0\0\0IEND\xaeB`\x82"
NOT_OURS = (
    "X-Plane's screenshots do not follow the camera: it takes the camera away before it draws them, so they show another view. "
    "Take the images off the screen instead (--pixels screen)"
)
# The essential chunks. Others (the time, the program) would make two files of the same picture differ.
CRITICAL = (b"IHDR", b"PLTE", b"IDAT", b"IEND")


class Screenshots:
    """The folder into which X-Plane writes them."""

    def __init__(self, xp: Xp) -> None:
        self._xp = xp
        self._folder = Path(xp.getSystemPath()) / "Output" / "screenshots"
        # Names in the folder when it was last listed, and its time of change then.
        self._names: set[str] = set()
        self._changed_ns: int | None = None
        self._listed_at = -LIST_GAP_S
        # Whether this client's were seen to show what the camera sees.
        self.proven = False

    def is_offered(self) -> bool:
        """Whether this X-Plane has the command."""
        return self._xp.findCommand(COMMAND) is not None

    def take(self, camera_is_ours: Callable[[], bool]) -> Generator[None, None, Frame]:
        """The next frame that X-Plane draws, as a PNG file; the camera may be lost then."""
        command = self._xp.findCommand(COMMAND)
        if command is None:
            raise Refusal(f"X-Plane does not know the command {COMMAND}")
        before = self._list()
        self._xp.commandOnce(command)
        if not camera_is_ours():
            # Nothing was drawn since.
            raise Refusal(NOT_OURS)
        deadline = time.monotonic() + FILE_LIMIT_S
        while time.monotonic() < deadline:
            yield
            for name in sorted(self._list() - before):
                png = _whole(self._folder / name)
                if png is not None:
                    self._remove(name)
                    return parse(png)
        raise Refusal(
            f"X-Plane wrote no screenshot into {self._folder} within {FILE_LIMIT_S:.0f} s: is the disk full, or the folder not to be written?"
        )

    def _list(self) -> set[str]:
        """The names in the folder; those of the last listing if nothing has changed."""
        try:
            changed_ns, now = self._folder.stat().st_mtime_ns, time.monotonic()
            if changed_ns != self._changed_ns or now - self._listed_at >= LIST_GAP_S:
                self._names = {name for name in os.listdir(self._folder) if name.endswith(".png")}
                self._changed_ns, self._listed_at = changed_ns, now
        except FileNotFoundError:
            # X-Plane makes it with the first one.
            self._names = set()
        return self._names

    def _remove(self, name: str) -> None:
        """A sweep would fill the disk."""
        try:
            (self._folder / name).unlink()
        except OSError as error:
            log(self._xp, f"the screenshot {name} cannot be removed: {error}")


def _whole(path: Path) -> bytes | None:
    """A file that X-Plane has finished writing."""
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise Refusal(f"{path} has more than {MAX_FILE_BYTES} bytes: that is no screenshot of X-Plane")
        png = path.read_bytes()
    except OSError:
        # On Windows a file that is being written cannot be read.
        return None
    return png if png.startswith(SIGNATURE) and png.endswith(END) else None


def parse(png: bytes) -> Frame:
    """Width, height, and the file without ancillary data."""
    size, kept, at = None, [SIGNATURE], len(SIGNATURE)
    while at + 12 <= len(png):
        length, kind = struct.unpack_from(">I4s", png, at)
        end = at + 12 + length
        if end > len(png):
            break
        if kind == b"IHDR" and length >= 8:
            size = struct.unpack_from(">II", png, at + 8)
        if kind in CRITICAL:
            kept.append(png[at:end])
        at = end
    if size is None or at != len(png):
        raise Refusal("X-Plane's screenshot is no sound PNG file")
    return size[0], size[1], b"".join(kept)
