"""The bridge: one step per simulator frame, in X-Plane's main thread.

Requests come from the sockets' threads through a queue, run one after the other in order, and are answered. A request that takes
several frames is a generator; each step of the bridge runs it to its next ``yield``. Steps are made before the flight model, where
everything may be called; after it, only values are patched.
"""

from __future__ import annotations

import queue
from collections import deque
from typing import Any, Generator

from . import NAME, VERSION, capture, installation, messages
from . import datarefs as names
from .capture import Answer
from .coded_frames import CodedFrames
from .datarefs import Datarefs
from .flight import Flights
from .found import Found
from .local_frame import LocalFrame
from .log import ClientLines, Faults, log
from .loops import FlightLoops
from .messages import LastingRefusal, Refusal
from .pixels import Pixels
from .profile import ProfileFile, refuse_unsound, still_pictures_move
from .scenery import Ground
from .server import Asked, Closed, Connection, LinkServer, Note, Opened
from .settings import Settings
from .stage import Stage
from .traffic import Traffic
from .wire import Header, printable
from .xp_api import Xp

# Time limits, in frames, for the check pattern to be drawn and for a pause to take effect.
FRAMES_LIMIT = 600
# Longest text of an error.
MAX_ERROR_CHARACTERS = 2_000

Task = Generator[None, None, Answer]


class Bridge:
    """Everything between the sockets and X-Plane, from enabling to disabling."""

    def __init__(self, xp: Xp, settings: Settings, gl_library: Any = None, profile: ProfileFile | None = None) -> None:
        self._xp = xp
        self._settings = settings
        self._faults = Faults(xp)
        self._lines = ClientLines(xp)
        self._datarefs = Datarefs(xp)
        self._frame = LocalFrame(xp.worldToLocal, xp.localToWorld)
        self._profile = profile
        self._stage = Stage(xp, self._datarefs, self._frame, self._faults)
        self._pixels = Pixels(xp, self._datarefs, self._faults, gl_library)
        self._ground = Ground(xp)
        self._traffic = Traffic(xp, self._datarefs)
        self._loops = FlightLoops(xp, self._faults, self._before_flight_model, self._after_flight_model)
        self._flights = Flights(self._stage, self._datarefs, self._frame, self._ground, self._traffic, self._loops, xp)
        self._found = Found(xp, self._datarefs)
        self._coded = CodedFrames(xp, self._stage, self._datarefs, self._pixels, self._send)
        self._settle_frames = 1
        self._margins_px = (0, 0)
        self._client: Connection | None = None
        self._waiting: deque[Asked] = deque()
        self._task: Task | None = None
        # Whether a client has left, and what it changed is not given back yet.
        self._leaving = False
        try:
            self._server = LinkServer(settings)
        except Exception:
            self._loops.close()
            raise
        dropped = profile.drop_if_unusable() if profile else None
        if dropped:
            log(xp, dropped)
        log(xp, f"capture link on {settings.bind}, port {self._server.port}")

    @property
    def port(self) -> int:
        """Where the link listens."""
        return self._server.port

    def close(self) -> None:
        """Gives back what needs no frame: values, the camera, callbacks. Commands and planes are not possible while X-Plane disables
        the plugin. A step that fails does not keep the others from being made."""
        for step in (
            self._loops.close, self._server.close, self._end_requests, self._stage.put_back, self._stage.release,
            self._pixels.unregister, self._found.give_back_values, self._say_what_is_left, self._faults.summarize,
        ):  # fmt: skip
            try:
                step()
            except Exception as error:
                self._faults.caught("disabling the plugin", error)

    def _say_what_is_left(self) -> None:
        left = [*self._found.what_is_left(), *self._traffic.what_is_left()]
        if left:
            log(self._xp, f"disabled in the middle of its work: {'; '.join(left)}")

    def _after_flight_model(self) -> None:
        """Values only."""
        self._stage.patch()
        self._flights.sample()

    def _before_flight_model(self) -> None:
        """One frame."""
        self._stage.begin_frame()
        self._finish_leaving()
        self._found.step()
        self._coded.step()
        if self._coded.is_busy and (error := self._stage.error or self._pixels.error):
            self._stage.error = self._pixels.error = None
            self._coded.fail(error)
        self._server.give_time()
        self._take_events()
        if self._client is not None:
            self._found.remember()
        if self._task is None:
            self._begin_next()
        # A request that takes no frame must not delay the next one by a frame; a pose written now is still drawn in this frame.
        while self._task is not None:
            answer = self._advance(self._task)
            if answer is None:
                return
            self._task = None
            self._send(answer)
            self._take_events()
            self._begin_next()
        self._pixels.rest()
        self._stage.keep_view()

    def _send(self, answer: Answer) -> None:
        if self._client is None:
            return
        try:
            self._client.answer(*answer)
        except ValueError as error:
            # JSON has no NaN: X-Plane gave us one.
            self._client.answer(*_error(f"this answer cannot be sent, perhaps because of X-Plane's numbers: {error}"))
        self._client.hand_over()

    def _take_events(self) -> None:
        while True:
            try:
                event = self._server.events.get_nowait()
            except queue.Empty:
                return
            if isinstance(event, Opened):
                try:
                    self._leave()
                finally:
                    self._client = event.connection
                    self._datarefs.forget_missing()
            elif isinstance(event, Asked):
                self._waiting.append(event)
            elif isinstance(event, Closed):
                if event.connection is self._client:
                    self._leave()
            elif isinstance(event, Note):
                self._lines.say("note", event.source, printable(event.text))

    def _leave(self) -> None:
        """The client is gone: nothing it requested remains."""
        self._end_requests()
        self._leaving = True
        self._finish_leaving()

    def _finish_leaving(self) -> None:
        """Gives back what the client changed; tried again in the next frame if it fails."""
        if self._leaving:
            self._leave_stage()
            self._found.client_left()
            self._faults.summarize()
            self._leaving = False

    def _end_requests(self) -> None:
        self._client = None
        self._waiting.clear()
        task, self._task = self._task, None
        if task is not None:
            task.close()
        self._loops.forget()
        self._coded.end()
        self._pixels.forget()

    def _begin_next(self) -> None:
        while self._waiting and self._waiting[0].connection.takes_more():
            header = self._waiting[0].header
            if header["message"] == "capture" and header.get("deliver") in messages.CODED:
                self._waiting.popleft()
                self._show_coded(header)
                continue
            # Answers keep the order of the requests.
            if not self._coded.is_busy:
                self._waiting.popleft()
                self._coded.end()
                self._task = self._run(header)
            return

    def _show_coded(self, header: Header) -> None:
        """A capture that is answered from the draw callback of its frame."""
        try:
            request = messages.capture(header, self._margins_px)
            self._check_capture()
            self._coded.show(request)
        except Refusal as refusal:
            # Answers keep the order of the requests.
            self._coded.fail(str(refusal))
            self._send(_error(str(refusal), refusal.repeats))
        except Exception as error:  # A bug of ours must not crash X-Plane.
            self._faults.caught("a request", error)
            self._coded.fail(f"the plugin failed: {error!r}")
            self._send(_error(f"the plugin failed: {error!r}"))

    def _advance(self, task: Task) -> Answer | None:
        """Advances a request; returns its answer when it is done."""
        try:
            next(task)
            return None
        except StopIteration as ended:
            answer: Answer = ended.value
            return answer
        except Refusal as refusal:
            return _error(str(refusal), refusal.repeats)
        except Exception as error:  # A bug of ours must not crash X-Plane.
            self._faults.caught("a request", error)
            return _error(f"the plugin failed: {error!r}")

    def _run(self, header: Header) -> Task:
        """A request as a generator, so that every rejection is caught in one place."""
        return (yield from self._task_of(header))

    def _task_of(self, header: Header) -> Task:
        message = header["message"]
        if message == "hello":
            source = self._client.source if self._client else ""
            self._lines.say("hello", source, f"client {printable(str(header.get('client')))}")
            return self._hello()
        if message == "capture":
            return self._capture(header)
        if message == "travel":
            self._stage.release()
            already_started = header.get("already_started", False) is True
            return self._flights.travel(messages.start(messages.part(header, "start")), already_started)
        if message == "fly":
            self._stage.release()
            return self._flights.fly(messages.fly(header))
        if message == "freeze":
            return self._freeze(header)
        if message == "command":
            return self._command(header)
        if message == "release":
            self._leave_stage()
            return _at_once({"message": "released"})
        if message == "check_pattern":
            return self._check_pattern(header)
        if message == "keep_profile":
            return self._keep_profile(header)
        if message == "still_shown":
            return _at_once({"message": "shown", "still": self._stage.still_shown})
        if message == "installation":
            return _at_once(installation.describe(self._xp.getSystemPath(), self._datarefs, self._pixels.renderer))
        raise LastingRefusal(f"the plugin knows no message {message!r}")

    def _hello(self) -> Task:
        pixels = ["screen"] if self._pixels.no_readback else ["gl", "screen"]
        # X-Plane always knows the size, but only sometimes the window's position on the desktop.
        width, height = (int(self._datarefs.get_or(name, 0.0)) for name in names.WINDOW_SIZE)
        profile = self._profile.read() if self._profile else None
        self._pixels.restless = still_pictures_move(profile)
        screen = self._server.screen_for(self._client) if self._client else None
        return _at_once(
            {
                **({"screen": screen} if screen is not None else {}),
                **({"profile": profile} if profile is not None else {}),
                "message": "hello",
                "name": "X-Plane",
                "version": self._version(),
                "plugin": f"{NAME} {VERSION}",
                "pixels": pixels,
                "frame_codes": True,
                "patterns_under": True,
                "window": self._window(),
                "drawn_size": {"width_px": width, "height_px": height},
            }
        )

    def _version(self) -> str:
        """X-Plane's version in human notation: 11.55, 12.4.0. Its number is the build of Log.txt: 124009 is 12.4.0, and before
        X-Plane 12 the minor version has two digits: 115501 is 11.55."""
        version = int(self._datarefs.get_or(names.VERSION, 0.0))
        major = version // 10_000
        if major < 12:
            return f"{major}.{version // 100 % 100:02}"
        return f"{major}.{version // 1_000 % 10}.{version // 100 % 10}"

    def _window(self) -> dict[str, Any] | None:
        """Where on the desktop X-Plane draws. A plugin knows that only for a full screen; a window must be located from outside."""
        bounds: list[tuple[int, int, int, int]] = []
        inside: list[tuple[int, int, int, int]] = []
        self._xp.getAllMonitorBoundsGlobal(lambda _i, *edges: inside.append(edges[:4]), None)
        self._xp.getAllMonitorBoundsOS(lambda _i, *edges: bounds.append(edges[:4]), None)
        if len(inside) != 1 or len(bounds) != 1:
            return None
        left, top, right, bottom = bounds[0]
        width, height = abs(right - left), abs(top - bottom)
        across = abs(inside[0][2] - inside[0][0])
        if not width or not height or not across:
            return None
        return {
            "title": "X-System",
            "x_px": left,
            "y_px": min(top, bottom),
            "width_px": width,
            "height_px": height,
            "scale": width / across,
        }

    def _freeze(self, header: Header) -> Task:
        if header.get("imaging"):
            raise LastingRefusal("X-Plane draws ideal images along straight lines: imaging has to be left out")
        messages.runway(messages.part(header, "runway"))
        self._settle_frames = messages.whole(header, "settle_frames", 1, 600)
        self._margins_px = messages.margins(header)
        running_at = messages.clock(messages.part(header, "running_at")) if header.get("running_at") else None
        self._stage.check_it_is_live()
        self._traffic.clear()
        self._stage.freeze(running_at)
        for _ in range(FRAMES_LIMIT):
            if self._stage.is_still():
                return {"message": "frozen"}, b""
            yield
        self._stage.release()
        raise Refusal(
            f"X-Plane does not {'run' if running_at else 'pause'} (sim/time/paused stays {int(running_at is not None)}): is a menu open?"
        )

    def _capture(self, header: Header) -> Task:
        request = messages.capture(header, self._margins_px)
        self._check_capture()
        return (yield from capture.take(request, self._stage, self._pixels, self._datarefs, self._settle_frames, self._xp))

    def _check_capture(self) -> None:
        if not self._stage.frozen:
            raise Refusal("a capture needs a frozen simulator: send freeze first")
        if self._pixels.pattern_code is not None:
            raise Refusal("the check pattern covers the window: take it away before capturing")
        if not self._stage.is_still():
            raise Refusal(
                "X-Plane was paused while it was to run: rain does not fall. Freeze again" if self._stage.time_runs
                else "X-Plane was taken out of its pause while frozen: nothing stands still. Freeze again"
            )

    def _command(self, header: Header) -> Task:
        path = header.get("path")
        if not isinstance(path, str) or not self._xp.findCommand(path):
            raise LastingRefusal(f"this X-Plane has no command {path!r}")
        self._stage.command(path)
        return _at_once({"message": "commanded"})

    def _check_pattern(self, header: Header) -> Task:
        code = header.get("code")
        if code is not None:
            code = messages.whole(header, "code", 0, 2**32 - 1)
        under = header.get("under", False) is True
        if under:
            # What a freeze closes is no cover.
            self._stage.close_windows()
        self._pixels.error = None
        self._pixels.show_pattern(code, under)
        drawn = self._pixels.patterns_drawn
        for _ in range(FRAMES_LIMIT):
            yield
            if self._pixels.error:
                self._pixels.show_pattern(None)
                raise Refusal(self._pixels.error)
            if code is None or self._pixels.patterns_drawn > drawn:
                return {"message": "check_pattern_shown", "sim_frame": self._stage.frames}, b""
        self._pixels.show_pattern(None)
        raise Refusal("X-Plane called no draw callback: it cannot show the check pattern")

    def _keep_profile(self, header: Header) -> Task:
        if self._profile is None:
            raise Refusal("this plugin has no place to keep a profile")
        profile = dict(messages.part(header, "profile"))
        refuse_unsound(profile)
        self._profile.keep(profile)
        self._pixels.restless = still_pictures_move(profile)
        return _at_once({"message": "profile_kept"})

    def _leave_stage(self) -> None:
        self._coded.end()
        self._pixels.show_pattern(None)
        self._stage.put_back()
        self._stage.release()
        self._traffic.give_back()
        self._found.give_back_the_stage()


def _at_once(header: Header, payload: bytes = b"") -> Task:
    """An answer that takes no frame."""
    return (header, payload)
    yield


def _error(text: str, repeats: bool = False) -> Answer:
    """Shortened: it may quote a request, which may be as long as a header."""
    header: Header = {"message": "error", "text": text[:MAX_ERROR_CHARACTERS]}
    if repeats:
        header["repeats"] = True
    return header, b""
