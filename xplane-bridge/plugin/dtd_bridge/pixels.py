"""Draw callbacks: reading the frame back, and drawing the check pattern. Whether this X-Plane supports it is decided once."""

from __future__ import annotations

from typing import Any, Callable

from . import datarefs as names
from .check_pattern import rectangles
from .datarefs import Datarefs
from .log import Faults
from .opengl import OpenGl, load_library
from .stage import Tick
from .xp_api import OnDraw, Xp

# Width, height, and red, green, blue from the top left.
Frame = tuple[int, int, bytes]
# Draw callbacks request this of the whole phase: X-Plane's SDK has 1 for before it, 0 for after. (XPPython3's documents swap the
# two.)
BEFORE, AFTER = 1, 0
# A draw callback that failed this often in a row will not succeed.
FAULTS_LIMIT = 10
# Frames without a request until frames are no longer read back.
IDLE_FRAMES = 30


class Pixels:
    """What the draw callbacks do. They come 0 to n times a frame, and exist only while they are needed: under Vulkan and Metal each
    one costs X-Plane a detour through OpenGL in every frame."""

    def __init__(self, xp: Xp, datarefs: Datarefs, faults: Faults, library: Any = None) -> None:
        self._xp = xp
        self._faults = faults
        # The callbacks that are registered now, with their place.
        self._registered: list[tuple[OnDraw, int]] = []
        self._failed_in_a_row = 0
        self._idle_frames = 0
        self._wanted = False
        self._frame: Frame | None = None
        # The last picture that counted, and what it shows.
        self._last: tuple[Tick, Frame] | None = None
        # Whether pictures move by themselves in a pause.
        self.restless = False
        self.pattern_code: int | None = None
        # Whether it is drawn under the windows of the user interface instead of over them.
        self.pattern_under = False
        # How often it was drawn.
        self.patterns_drawn = 0
        self._draw_code: Callable[[OpenGl], None] | None = None
        self.error: str | None = None
        # Who draws for plugins, once something was drawn.
        self.renderer: str | None = None
        self._gl: OpenGl | None = None
        # X-Plane 11 only: 12 draws with Vulkan or Metal, which plugins cannot access.
        self.no_readback: str | None = None
        try:
            self._gl = OpenGl(library if library is not None else load_library())
        except OSError as error:
            self.no_readback = f"there is no OpenGL library: {error}"
        if not datarefs.is_x_plane_11:
            self.no_readback = "X-Plane 12 draws with Vulkan or Metal, which plugins cannot read back"
        elif datarefs.get_or(names.MODERN_DRIVER, 0.0) != 0:
            self.no_readback = (
                "X-Plane 11 draws with Vulkan or Metal: switch that off in Settings > Graphics to read pixels back"
            )

    def unregister(self) -> None:
        """Unregisters all callbacks."""
        self._need(self.on_scene_drawn, BEFORE, False)
        self._need(self.on_windows_drawn, AFTER, False)

    def _need(self, callback: OnDraw, place: int, needed: bool) -> None:
        """Registers a callback while it is needed."""
        registration = (callback, place)
        if needed and registration not in self._registered:
            self._xp.registerDrawCallback(callback, self._xp.Phase_Window, place, None)
            self._registered.append(registration)
        elif not needed and registration in self._registered:
            # The very object that was registered: another one of the same method is equal, but need not be the same to XPPython3.
            registered, _ = self._registered.pop(self._registered.index(registration))
            self._xp.unregisterDrawCallback(registered, self._xp.Phase_Window, place, None)

    def show_pattern(self, code: int | None, under: bool = False) -> None:
        """Shows the check pattern with a code from the next frame on, over the windows or under them, or removes it."""
        self.pattern_code, self.pattern_under = code, under
        self._need(self.on_scene_drawn, BEFORE, code is not None and under)
        self._need(self.on_windows_drawn, AFTER, code is not None and not under)

    def show_codes(self, draw: Callable[[OpenGl], None] | None) -> None:
        """Calls this in every frame after the windows are drawn, or no longer."""
        self._draw_code = draw
        self._need(self.on_windows_drawn, AFTER, draw is not None)

    def rest(self) -> None:
        """One frame in which there is no request."""
        self._idle_frames += 1
        if self._idle_frames > IDLE_FRAMES and not self.pattern_under:
            self._need(self.on_scene_drawn, BEFORE, False)

    def want_frame(self) -> None:
        """Requests that the next drawn frame is read back."""
        self._wanted, self._frame, self._idle_frames = True, None, 0
        self._need(self.on_scene_drawn, BEFORE, True)

    def take_frame(self) -> Frame | None:
        """The frame that was read back, if one was drawn."""
        frame, self._frame, self._wanted = self._frame, None, False
        return frame

    def forget(self) -> None:
        """A new client: nothing is requested, and no image was taken."""
        self.take_frame()
        self.pattern_code, self._draw_code, self._last, self.error = None, None, None, None
        self.pattern_under = False
        self.unregister()

    def is_new(self, tick: Tick, picture: Frame) -> bool:
        """Whether an image is proven to be that of a tick: the previous one, of another tick, shows something else."""
        return self._last is not None and (self._last[0] == tick or self._last[1] != picture)

    def remember(self, tick: Tick, picture: Frame) -> None:
        """This image counted."""
        self._last = (tick, picture)

    def on_scene_drawn(self, _phase: int, _is_before: int, _refcon: object) -> int:
        """Before the windows of the user interface are drawn: the scene is complete and nothing covers it."""
        try:
            if self._wanted and self._frame is None and self._gl:
                self._frame = self._gl.read_frame()
            if self.pattern_under:
                self._draw_wanted_pattern()
            self._failed_in_a_row = 0
        except Exception as error:
            self._failed("read the frame back, or draw under the windows", error)
        return 1

    def on_windows_drawn(self, _phase: int, _is_before: int, _refcon: object) -> int:
        """After everything: the pattern covers it."""
        try:
            if self.renderer is None and self._gl:
                self.renderer = self._gl.renderer()
            if self.pattern_code is not None and not self.pattern_under:
                self._draw_wanted_pattern()
            elif self._draw_code is not None and self._gl:
                self._draw_code(self._gl)
            self._failed_in_a_row = 0
        except Exception as error:
            self._failed("draw over the frame", error)
        return 1

    def _failed(self, what: str, error: Exception) -> None:
        """The next frame may succeed, unless it goes on like that."""
        self._faults.caught("a draw callback", error)
        self._failed_in_a_row += 1
        if self._failed_in_a_row >= FAULTS_LIMIT:
            self._failed_in_a_row = 0
            self.error = f"cannot {what}: {error!r}"

    def _draw_wanted_pattern(self) -> None:
        if self.pattern_code is not None and self._gl:
            self._draw_pattern(self._gl, self.pattern_code)
            self.patterns_drawn += 1

    def _draw_pattern(self, gl: OpenGl, code: int) -> None:
        # Pixels are physical, the phase's coordinates are X-Plane's own ("boxels"), from the bottom left.
        width, height = gl.viewport_size()
        screen_width, screen_height = self._xp.getScreenSize()
        across, up = screen_width / width, screen_height / height
        self._xp.setGraphicsState(0, 0, 0, 0, 0, 0, 0)
        for left, top, right, bottom, rgb in rectangles(code, width, height):
            gl.fill(left * across, screen_height - bottom * up, right * across, screen_height - top * up, rgb)
