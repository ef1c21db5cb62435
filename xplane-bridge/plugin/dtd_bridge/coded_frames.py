"""Captures that are shown for one drawn frame each, while the camera rests: ``deliver`` is coded or probe.

The camera callback is the only place that moves on to the next request and writes pose and camera. The draw callback of the same frame
reads both back, answers the request with the frame's number, and draws that number into the margins around the image. The client grabs
the window and knows by the number what it sees. While no request waits, the last one stays, under new numbers.
"""

from __future__ import annotations

import time
from collections import deque
from typing import Any, Callable

from . import capture as capturing
from .capture import Answer
from .datarefs import Datarefs
from .frame_code import MARGIN_PX, code_of, rectangles
from .frame_numbers import FrameNumbers
from .messages import Capture, LastingRefusal
from .opengl import OpenGl
from .pixels import Pixels
from .stage import Stage, Tick
from .xp_api import Xp

# Frames whose values X-Plane gives back differently before they are reported as they are.
TRIES = 5


class CodedFrames:
    """The requests that wait, and the one that is shown."""

    def __init__(self, xp: Xp, stage: Stage, datarefs: Datarefs, pixels: Pixels, answer: Callable[[Answer], None]) -> None:
        self._xp = xp
        self._stage = stage
        self._datarefs = datarefs
        self._pixels = pixels
        self._answer = answer
        self._numbers = FrameNumbers()
        self._waiting: deque[Capture] = deque()
        self._shown: Capture | None = None
        self._answered = True
        self._tries = 0
        self._since = 0.0

    @property
    def is_on(self) -> bool:
        """Whether frames carry codes."""
        return self._shown is not None

    @property
    def is_busy(self) -> bool:
        """Whether a request is unanswered."""
        return bool(self._waiting) or not self._answered

    def show(self, request: Capture) -> None:
        """Shows a request in one of the next frames, after those that wait.

        Raises :class:`LastingRefusal` if the window has no room for the code.
        """
        if min(request.margin_x_px, request.margin_y_px) < MARGIN_PX:
            raise LastingRefusal(f"the margins are {request.margin_x_px} and {request.margin_y_px} pixels, expected {MARGIN_PX} or more for the code")
        capturing.check_window(request, self._datarefs)
        if not self.is_busy:
            self._since = time.monotonic()
        self._waiting.append(request)
        if self._shown is None:
            self._numbers.begin(self._stage.frames)
            self._next()
            self._stage.next_tick = self._on_camera
            self._pixels.show_codes(self.draw)

    def end(self) -> None:
        """Frames carry no code any more; what waits is forgotten."""
        self._waiting.clear()
        self._answered = True
        if self._shown is not None:
            self._shown = self._stage.next_tick = None
            self._pixels.show_codes(None)

    def step(self) -> None:
        """One frame, from the flight loop."""
        if not self.is_on:
            return
        self._numbers.loop()
        if not self._is_ours():
            self._numbers.doubt()
            self._stage.keep_camera()
        if self.is_busy and time.monotonic() - self._since > capturing.TIME_LIMIT_S:
            self.fail(f"no frame of the request within {capturing.TIME_LIMIT_S:.0f} s: {self._stage.what_is_wrong_with_the_view()}")

    def fail(self, text: str) -> None:
        """Answers all requests with an error, in their order, and ends."""
        unanswered = len(self._waiting) + (not self._answered)
        self.end()
        for _ in range(unanswered):
            self._answer(({"message": "error", "text": text}, b""))

    def draw(self, gl: OpenGl) -> None:
        """From the draw callback after the windows."""
        shown = self._shown
        if shown is None:
            return
        if not self._numbers.drawn():
            return
        if not self._is_ours() or not (self._answered or self._is_drawn(shown)):
            self._numbers.doubt()
            return
        width, height = gl.viewport_size()
        screen_width, screen_height = self._xp.getScreenSize()
        across, up = screen_width / width, screen_height / height
        code = code_of(self._numbers.number, self._numbers.steady, shown.deliver == "probe", shown.view)
        self._xp.setGraphicsState(0, 0, 0, 0, 0, 0, 0)
        for left, top, right, bottom, rgb in rectangles(code, width, height, shown.margin_x_px, shown.margin_y_px):
            gl.fill(left * across, screen_height - bottom * up, right * across, screen_height - top * up, rgb)

    def _is_ours(self) -> bool:
        return self._stage.is_shown() and self._stage.is_still() and not self._stage.scenery_is_loading()

    def _on_camera(self) -> Tick | None:
        """The next request's tick, if a new frame begins and one waits."""
        if self._numbers.camera() and self._answered and self._waiting:
            self._next()
        return capturing.tick_of(self._shown) if self._shown is not None else None

    def _next(self) -> None:
        self._shown = self._waiting.popleft()
        self._answered, self._tries = False, 0
        self._stage.show(capturing.tick_of(self._shown))

    def _is_drawn(self, shown: Capture) -> bool:
        """Whether X-Plane gives back what was written; then the request is answered."""
        pose, (camera, hfov_deg, vfov_deg) = self._stage.read_pose(), self._stage.read_camera()
        self._tries += 1
        if not capturing.is_as_wanted(shown, pose, camera, hfov_deg, vfov_deg) and self._tries < TRIES:
            return False
        answer = capturing.answer(shown, self._numbers.number, pose, camera, hfov_deg, None)
        self._answered = True
        self._since = time.monotonic()
        self._answer(answer)
        return True
