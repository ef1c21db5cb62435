"""Draw callbacks: reading the frame back, and drawing the check pattern. Whether this X-Plane supports it is decided once."""

from __future__ import annotations

from typing import Any, Callable

from . import callbacks
from . import datarefs as names
from .callbacks import Callbacks
from .check_pattern import rectangles
from .datarefs import Datarefs
from .opengl import OpenGl, load_library
from .stage import Tick
from .xp_api import Xp

# Width, height, and red, green, blue from the top left.
Frame = tuple[int, int, bytes]
# Draw callbacks request this of the whole phase: X-Plane's SDK has 1 for before it, 0 for after. (XPPython3's documents swap the
# two.)
BEFORE, AFTER = 1, 0


class Pixels:
    """What the draw callbacks do. They come 0 to n times a frame."""

    def __init__(self, xp: Xp, datarefs: Datarefs, callbacks_seen: Callbacks, library: Any = None) -> None:
        self._xp = xp
        self._callbacks = callbacks_seen
        self._wanted = False
        self._frame: Frame | None = None
        # The last picture that counted, and what it shows.
        self._last: tuple[Tick, Frame] | None = None
        # Whether pictures move by themselves in a pause.
        self.restless = False
        self.pattern_code: int | None = None
        # How often it was drawn.
        self.patterns_drawn = 0
        # Draws over the finished frame, in a frame that carries its number.
        self.draw_code: Callable[[OpenGl], None] | None = None
        self.error: str | None = None
        self._gl: OpenGl | None = None
        # X-Plane 11 only: 12 draws with Vulkan or Metal, which plugins cannot access.
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
        """Registers the callbacks."""
        self._xp.registerDrawCallback(self.on_scene_drawn, self._xp.Phase_Window, BEFORE, None)
        self._xp.registerDrawCallback(self.on_windows_drawn, self._xp.Phase_Window, AFTER, None)

    def unregister(self) -> None:
        """Unregisters the callbacks."""
        self._xp.unregisterDrawCallback(self.on_scene_drawn, self._xp.Phase_Window, BEFORE, None)
        self._xp.unregisterDrawCallback(self.on_windows_drawn, self._xp.Phase_Window, AFTER, None)

    def want_frame(self) -> None:
        """Requests that the next drawn frame is read back."""
        self._wanted, self._frame = True, None

    def take_frame(self) -> Frame | None:
        """The frame that was read back, if one was drawn."""
        frame, self._frame, self._wanted = self._frame, None, False
        return frame

    def forget(self) -> None:
        """A new client: nothing is requested, and no picture was taken."""
        self.take_frame()
        self.pattern_code, self._last = None, None

    def is_new(self, tick: Tick, picture: Frame) -> bool:
        """Whether a picture is proven to be that of a tick: the previous one, of another tick, shows something else."""
        return self._last is not None and (self._last[0] == tick or self._last[1] != picture)

    def remember(self, tick: Tick, picture: Frame) -> None:
        """This picture counted."""
        self._last = (tick, picture)

    def on_scene_drawn(self, _phase: int, _is_before: int, _refcon: object) -> int:
        """Before the windows of the user interface are drawn: the scene is complete and nothing covers it."""
        try:
            self._callbacks.note(callbacks.DRAW)
            if self._wanted and self._frame is None and self._gl:
                self._frame = self._gl.read_frame()
        except Exception as error:
            self.error = f"cannot read the frame back: {error!r}"
        return 1

    def on_windows_drawn(self, _phase: int, _is_before: int, _refcon: object) -> int:
        """After everything: the pattern covers it."""
        try:
            if self.pattern_code is not None and self._gl:
                self._draw_pattern(self._gl, self.pattern_code)
                self.patterns_drawn += 1
            elif self.draw_code is not None and self._gl:
                self.draw_code(self._gl)
        except Exception as error:
            self.error = f"cannot draw over the frame: {error!r}"
        return 1

    def _draw_pattern(self, gl: OpenGl, code: int) -> None:
        # Pixels are physical, the phase's coordinates are X-Plane's own ("boxels"), from the bottom left.
        width, height = gl.viewport_size()
        screen_width, screen_height = self._xp.getScreenSize()
        across, up = screen_width / width, screen_height / height
        self._xp.setGraphicsState(0, 0, 0, 0, 0, 0, 0)
        for left, top, right, bottom, rgb in rectangles(code, width, height):
            gl.fill(left * across, screen_height - bottom * up, right * across, screen_height - top * up, rgb)
