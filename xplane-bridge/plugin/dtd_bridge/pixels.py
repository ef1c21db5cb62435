"""Draw callbacks: reading the frame back, and drawing the check pattern. Whether this X-Plane can is decided once."""

from __future__ import annotations

from typing import Any

from . import datarefs as names
from .check_pattern import rectangles
from .datarefs import Datarefs
from .opengl import OpenGl, load_library


class Pixels:
    """What the draw callbacks do. They come 0 to n times a frame, so nothing is counted in them."""

    def __init__(self, xp: Any, datarefs: Datarefs, library: Any = None) -> None:
        self._xp = xp
        self._wanted = False
        self._frame: tuple[int, int, bytes] | None = None
        self._read_in_cycle: int | None = None
        self.pattern_code: int | None = None
        self.pattern_drawn_in: int | None = None
        self.error: str | None = None
        self._gl: OpenGl | None = None
        # X-Plane 11 only: 12 draws with Vulkan or Metal, out of reach for plugins.
        version = datarefs.get_or(names.VERSION, 0.0)
        self.no_readback: str | None = None
        try:
            self._gl = OpenGl(library if library is not None else load_library())
        except OSError as error:
            self.no_readback = f"there is no OpenGL library: {error}"
        if version >= 120_000:
            self.no_readback = "X-Plane 12 draws with Vulkan or Metal, which plugins cannot read back"
        elif datarefs.get_or(names.MODERN_DRIVER, 0.0) != 0:
            self.no_readback = (
                "X-Plane 11 draws with Vulkan or Metal: switch that off in Settings > Graphics to read pixels back"
            )

    def register(self) -> None:
        """From now on X-Plane calls."""
        self._xp.registerDrawCallback(self.on_scene_drawn, self._xp.Phase_Window, 0, None)
        self._xp.registerDrawCallback(self.on_windows_drawn, self._xp.Phase_Window, 1, None)

    def unregister(self) -> None:
        """X-Plane calls no more."""
        self._xp.unregisterDrawCallback(self.on_scene_drawn, self._xp.Phase_Window, 0, None)
        self._xp.unregisterDrawCallback(self.on_windows_drawn, self._xp.Phase_Window, 1, None)

    def want_frame(self, wanted: bool) -> None:
        """Whether the next frame is to be read back."""
        self._wanted, self._frame, self._read_in_cycle = wanted, None, None

    def take_frame(self, cycle: int) -> tuple[int, int, bytes] | None:
        """The frame of that cycle, if it was read back."""
        frame, self._frame = self._frame, None
        return frame if self._read_in_cycle == cycle else None

    def on_scene_drawn(self, _phase: int, _after: int, _refcon: object) -> int:
        """Before the windows of the user interface are drawn: the scene is whole and nothing lies over it."""
        try:
            cycle = self._xp.getCycleNumber()
            if self._wanted and self._gl and self._read_in_cycle != cycle:
                self._frame = self._gl.read_frame()
                self._read_in_cycle = cycle
        except Exception as error:
            self.error = f"cannot read the frame back: {error!r}"
        return 1

    def on_windows_drawn(self, _phase: int, _after: int, _refcon: object) -> int:
        """After everything: the pattern lies over it."""
        try:
            if self.pattern_code is not None and self._gl:
                self._draw_pattern(self._gl, self.pattern_code)
                self.pattern_drawn_in = self._xp.getCycleNumber()
        except Exception as error:
            self.error = f"cannot draw the check pattern: {error!r}"
        return 1

    def _draw_pattern(self, gl: OpenGl, code: int) -> None:
        # Pixels are physical, the phase's coordinates are X-Plane's own ("boxels"), from the bottom left.
        width, height = gl.viewport_size()
        screen_width, screen_height = self._xp.getScreenSize()
        across, up = screen_width / width, screen_height / height
        self._xp.setGraphicsState(0, 0, 0, 0, 0, 0, 0)
        for left, top, right, bottom, rgb in rectangles(code, width, height):
            gl.fill(left * across, screen_height - bottom * up, right * across, screen_height - top * up, rgb)
