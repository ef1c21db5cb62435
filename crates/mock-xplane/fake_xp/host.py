"""Runs the plugin against the fake ``xp`` in a separate process; the world is the stand-in's, at the other end of standard input
and output.

Each question is one line of JSON, ``[what, ...]``; so is each answer. Only an image's answer, its number of bytes, is followed by bytes.
A statement is a question whose name ends with ``!``: it has no answer and is sent with the next question. X-Plane's functions cost nothing,
whereas a question costs two changes of the running process, and a frame of the plugin would need more than a hundred of them.
"""

from __future__ import annotations

import importlib
import itertools
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from fake_xp import FakeGl, FakeXp, Kind
from held_lock import HeldPipe, pause_until
from xp_rules import ENABLE, START

# The stand-in has no screen to wait for; without a pause an idle plugin would take a whole core.
MIN_PAUSE_S = 0.001
# The list of values to read is rebuilt after so many frames; at most so many conversions are remembered.
FRAMES_REMEMBERED = 64
MAX_CONVERSIONS = 1_000


# What X-Plane writes about itself, in the form of public logs and preferences.
OWN_FILES = {
    "Log.txt": """\
Desktop session type: x11
Vulkan Device       : The stand-in's renderer
Vulkan Driver       : 1.0.0
Loaded: Resources/plugins/XPPython3/lin_x64/XPPython3.xpl (xppython3.main).
""",
    "Output/preferences/X-Plane.prf": "renopt_MSAA 0\nrenopt_FSR_04 0\nrenopt_draw_3d_04 2\n",
    "Custom Scenery/scenery_packs.ini": "I\n1000 Version\nSCENERY\n\nSCENERY_PACK Custom Scenery/Global Airports/\n",
}


class PipeWorld:
    """Implements ``fake_xp.World``."""

    def __init__(self, pipe: HeldPipe, cockpit_view: bool) -> None:
        self._pipe = pipe
        self._kinds: dict[str, Kind | None] = {}
        self._published: dict[str, float] = {}
        self._lines: list[bytes] = []
        # The values that are read, all with one question, and their content until something changes.
        self._wanted: list[tuple[str, int]] = []
        self._values: dict[tuple[str, int], float] = {}
        # Conversions, and the origin for which they hold.
        self._converted: dict[tuple[Any, ...], tuple[float, float, float]] = {}
        self._origin: Any = None
        self.cockpit_view = cockpit_view
        # X-Plane's folder, for X-Plane's own files.
        self._path = tempfile.TemporaryDirectory(prefix="dtd-stand-in-")
        for name, text in OWN_FILES.items():
            path = Path(self._path.name, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")

    def _ask(self, *question: Any) -> Any:
        self._queue(*question)
        self.flush()
        line = self._pipe.readline()
        if not line:
            # The stand-in is gone.
            sys.exit(0)
        return json.loads(line)

    def _say(self, what: str, *content: Any) -> None:
        self._queue(f"{what}!", *content)

    def _queue(self, *line: Any) -> None:
        self._lines.append(json.dumps(line).encode() + b"\n")

    def _change(self, what: str, *content: Any) -> None:
        """A statement that may change any value."""
        self._values.clear()
        self._say(what, *content)

    def flush(self) -> None:
        """Sends the statements."""
        lines, self._lines = self._lines, []
        self._pipe.write(b"".join(lines))

    def kind(self, name: str) -> Kind | None:
        if name not in self._kinds:
            found = self._ask("kind", name)
            self._kinds[name] = None if found is None else Kind(*found)
        return self._kinds[name]

    def get(self, name: str, index: int) -> float:
        wanted = (name, index)
        if wanted not in self._values:
            if wanted not in self._wanted:
                self._wanted.append(wanted)
                self._say("want", name, index)
            self._values = dict(zip(self._wanted, self._ask("values")))
        return self._values[wanted]

    def set(self, name: str, index: int, value: float) -> None:
        self._change("set", name, index, value)

    def knows_command(self, path: str) -> bool:
        return self._ask("knows_command", path)

    def command(self, path: str) -> None:
        self._change("command", path)

    def world_to_local(self, latitude: float, longitude: float, altitude: float) -> tuple[float, float, float]:
        return self._convert("world_to_local", latitude, longitude, altitude)

    def local_to_world(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        return self._convert("local_to_world", x, y, z)

    def _convert(self, *question: Any) -> tuple[float, float, float]:
        if question not in self._converted:
            if len(self._converted) >= MAX_CONVERSIONS:
                self._converted.clear()
            self._converted[question] = tuple(self._ask(*question))
        return self._converted[question]

    def ground_below(self, x: float, y: float, z: float) -> tuple[float, float, float] | None:
        ground = self._ask("ground_below", x, y, z)
        return None if ground is None else tuple(ground)

    def place_user(self, latitude: float, longitude: float, altitude: float, heading: float, speed: float) -> None:
        # The origin may move.
        self._converted.clear()
        self._origin = None
        self._change("place_user", latitude, longitude, altitude, heading, speed)

    def publish(self, name: str, value: float) -> None:
        if self._published.get(name) != value:
            self._published[name] = value
            self._change("publish", name, value)

    def begin_frame(self) -> int:
        self._values.clear()
        frame, origin = self._ask("begin_frame")
        if origin != self._origin:
            self._origin = origin
            self._converted.clear()
        if frame % FRAMES_REMEMBERED == 0:
            self._wanted.clear()
            self._say("want_nothing")
        return frame

    def place_camera(self, position: list[float] | None) -> None:
        if position is not None:
            self._change("place_camera", *position)
        elif self.cockpit_view:
            self._change("own_camera")

    def show_frame(self, rectangles: list[tuple[float, ...]]) -> None:
        self._ask("show", rectangles)

    def lose_camera(self) -> None:
        self._change("lose_camera")

    def others_fly(self) -> bool:
        return self._ask("others_fly")

    def let_others_fly(self, fly: bool) -> None:
        self._change("let_others_fly", int(fly))

    def system_path(self) -> str:
        return self._path.name

    def render(self, width: int, height: int, windows: bool = False) -> bytes:
        count = self._ask("render", width, height, windows)
        return self._pipe.read(count)


class KeptInMemory:
    """A profile that lasts as long as this stand-in: the plugin's folder is the user's."""

    def __init__(self, _path: Any) -> None:
        self._profile: dict[str, Any] | None = None

    def drop_if_unusable(self) -> None:
        """There is no file."""

    def read(self) -> dict[str, Any] | None:
        return self._profile

    def keep(self, profile: dict[str, Any]) -> None:
        self._profile = profile


class LoggingXp(FakeXp):
    """Logs into the stand-in's log."""

    def log(self, text: str) -> None:
        super().log(text)
        if text:
            self.world._say("log", text)
            self.world.flush()


def run(settings: dict[str, Any]) -> None:
    """Forever, or until the stand-in goes away. The interpreter lock is held all the time, as XPPython3 does between callbacks: the
    plugin's threads run only while a callback waits."""
    quirks = frozenset(settings["quirks"])
    world = PipeWorld(HeldPipe(sys.stdin.fileno(), sys.stdout.fileno()), "cockpit_view" in quirks)
    # The plugin's output must not be mistaken for a question.
    sys.stdout = sys.stderr
    xp = LoggingXp(world, quirks)
    xp.shows_frames = settings["shows_frames"]
    if settings["is_x_plane_11"]:
        package = type(sys)("XPPython3")
        package.xp = xp
        sys.modules.update({"XPPython3": package, "xp": None})
    else:
        sys.modules["xp"] = xp
    sys.path.insert(0, settings["plugin"])
    plugin = importlib.import_module("PI_dtd_bridge")
    pixels = importlib.import_module("dtd_bridge.pixels")
    pixels.load_library = lambda: FakeGl(xp)
    # How long one second of the plugin's waiting takes: by the simulator's clock, or nothing if there is nothing to wait for.
    pace = settings["pace"]
    scenery, found = (importlib.import_module(f"dtd_bridge.{name}") for name in ("scenery", "found"))
    scenery.HOLD_S *= pace
    scenery.PROBE_GAP_S *= pace
    # Clients come back at once, or not at all.
    found.COMES_BACK_WITHIN_S = max(1.0, found.COMES_BACK_WITHIN_S * pace)
    defaults = importlib.import_module("dtd_bridge.settings").Settings
    link = defaults(
        bind=settings["bind"],
        port=settings["port"],
        token=settings["token"],
        weather_settle_s=defaults.weather_settle_s * pace,
    )
    plugin.read_settings = lambda _path: link
    plugin.ProfileFile = KeptInMemory
    interface = plugin.PythonInterface()
    with xp.inside(START):
        interface.XPluginStart()
    with xp.inside(ENABLE):
        interface.XPluginEnable()
    steal_every = settings["steal_camera_every_frames"]
    period_s = settings["least_frame_s"]
    for frame in itertools.count(1):
        began_s = time.monotonic()
        xp.frame()
        if steal_every and frame % steal_every == 0:
            xp.steal_camera()
        world.flush()
        if xp.misplaced:
            sys.exit(f"the plugin called what X-Plane does not allow there: {xp.misplaced}")
        pause_until(max(began_s + period_s, time.monotonic() + MIN_PAUSE_S))
