"""The few OpenGL calls that the plugin needs, through the system's own library. Only inside draw callbacks."""

from __future__ import annotations

import ctypes
import sys
from typing import Any

GL_VIEWPORT = 0x0BA2
GL_RENDERER = 0x1F01
GL_PACK_ALIGNMENT = 0x0D05
GL_RGB = 0x1907
GL_UNSIGNED_BYTE = 0x1401


def load_library() -> Any:
    """The library that X-Plane draws with; OSError if there is none."""
    if sys.platform == "win32":
        return ctypes.WinDLL("opengl32")  # type: ignore[attr-defined]
    if sys.platform == "darwin":
        return ctypes.CDLL("/System/Library/Frameworks/OpenGL.framework/OpenGL")
    return ctypes.CDLL("libGL.so.1")


class OpenGl:
    """A loaded library."""

    def __init__(self, library: Any) -> None:
        self._gl = library

    def renderer(self) -> str:
        """Who draws: its name begins with zink where OpenGL is drawn by Vulkan."""
        get_string = self._gl.glGetString
        get_string.restype = ctypes.c_char_p
        name: bytes | None = get_string(GL_RENDERER)
        return (name or b"").decode("utf-8", "replace")

    def viewport_size(self) -> tuple[int, int]:
        """Physical pixels, width and height, of what is being drawn."""
        viewport = (ctypes.c_int * 4)()
        self._gl.glGetIntegerv(GL_VIEWPORT, viewport)
        return viewport[2], viewport[3]

    def read_frame(self) -> tuple[int, int, bytes]:
        """What has been drawn of the frame so far: width, height, and red, green, blue from the top left."""
        viewport = (ctypes.c_int * 4)()
        self._gl.glGetIntegerv(GL_VIEWPORT, viewport)
        x, y, width, height = viewport
        pixels = ctypes.create_string_buffer(max(1, width * height * 3))
        while self._gl.glGetError():
            # Left over from somebody else.
            pass
        self._gl.glPixelStorei(GL_PACK_ALIGNMENT, 1)
        self._gl.glReadPixels(x, y, width, height, GL_RGB, GL_UNSIGNED_BYTE, pixels)
        error = self._gl.glGetError()
        if error:
            raise RuntimeError(f"glReadPixels failed with OpenGL error {error:#x}")
        # OpenGL's first row is the lowest.
        raw, row = pixels.raw, width * 3
        rows = (raw[at : at + row] for at in range((height - 1) * row, -1, -row))
        return width, height, b"".join(rows)

    def fill(self, left: float, bottom: float, right: float, top: float, rgb: tuple[int, int, int]) -> None:
        """Fills a rectangle of the 2-D phases' coordinates."""
        self._gl.glColor3ub(*(ctypes.c_ubyte(c) for c in rgb))
        self._gl.glRectf(*(ctypes.c_float(c) for c in (left, bottom, right, top)))
