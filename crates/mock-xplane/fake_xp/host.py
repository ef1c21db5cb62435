"""Runs the plugin against the fake ``xp`` in a separate process; the world is the stand-in's, at the other end of standard input
and output.

Each question is one line of JSON, ``[what, ...]``; so is each answer. Only a picture's answer, its number of bytes, is followed by bytes.
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
LEAST_PAUSE_S = 0.001


class PipeWorld:
    """Implements ``fake_xp.World``."""

    def __init__(self, pipe: HeldPipe, cockpit_view: bool) -> None:
        self._pipe = pipe
        self._kinds: dict[str, Kind | None] = {}
        self._published: dict[str, float] = {}
        self.cockpit_view = cockpit_view
        # X-Plane's folder, for X-Plane's own files.
        self._path = tempfile.TemporaryDirectory(prefix="dtd-stand-in-")
        Path(self._path.name, "Log.txt").touch()

    def _ask(self, *question: Any) -> Any:
        self._pipe.write(json.dumps(question).encode() + b"\n")
        line = self._pipe.readline()
        if not line:
            # The stand-in is gone.
            sys.exit(0)
        return json.loads(line)

    def kind(self, name: str) -> Kind | None:
        if name not in self._kinds:
            found = self._ask("kind", name)
            self._kinds[name] = None if found is None else Kind(*found)
        return self._kinds[name]

    def get(self, name: str, index: int) -> float:
        return self._ask("get", name, index)

    def set(self, name: str, index: int, value: float) -> None:
        self._ask("set", name, index, value)

    def knows_command(self, path: str) -> bool:
        return self._ask("knows_command", path)

    def command(self, path: str) -> None:
        self._ask("command", path)

    def world_to_local(self, latitude: float, longitude: float, altitude: float) -> tuple[float, float, float]:
        return tuple(self._ask("world_to_local", latitude, longitude, altitude))

    def local_to_world(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        return tuple(self._ask("local_to_world", x, y, z))

    def ground_below(self, x: float, y: float, z: float) -> tuple[float, float, float] | None:
        ground = self._ask("ground_below", x, y, z)
        return None if ground is None else tuple(ground)

    def place_user(self, latitude: float, longitude: float, altitude: float, heading: float, speed: float) -> None:
        self._ask("place_user", latitude, longitude, altitude, heading, speed)

    def publish(self, name: str, value: float) -> None:
        if self._published.get(name) != value:
            self._published[name] = value
            self._ask("publish", name, value)

    def begin_frame(self) -> int:
        return self._ask("begin_frame")

    def place_camera(self, position: list[float] | None) -> None:
        if position is not None:
            self._ask("place_camera", *position)
        elif self.cockpit_view:
            self._ask("own_camera")

    def show_frame(self, rectangles: list[tuple[float, ...]]) -> None:
        self._ask("show", rectangles)

    def lose_camera(self) -> None:
        self._ask("lose_camera")

    def others_fly(self) -> bool:
        return self._ask("others_fly")

    def let_others_fly(self, fly: bool) -> None:
        self._ask("let_others_fly", int(fly))

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
            self.world._ask("log", text)


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
        if xp.misplaced:
            sys.exit(f"the plugin called what X-Plane does not allow there: {xp.misplaced}")
        pause_until(max(began_s + period_s, time.monotonic() + LEAST_PAUSE_S))
