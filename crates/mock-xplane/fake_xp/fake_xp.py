"""A strict fake of XPPython3's module ``xp``, limited to what our plugin uses.

It follows X-Plane's order within a frame (flight loops, camera, drawing), its habits (the camera's list must be changed in place,
values are 32-bit, writes to read-only datarefs are ignored) and its prohibitions: no call from another thread, nor from a place that
``xp_rules.py`` forbids. It records the names of all look-ups. What it knows about the simulated world comes from a :class:`World`: an in-memory one for tests, or the stand-in's at the other end of a pipe
(``host.py``).

Made for this project from XPPython3's documentation; it has never been compared with a running X-Plane.
"""

from __future__ import annotations

import contextlib
import struct
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Iterator, Protocol

import xp_rules as rules


@dataclass(frozen=True)
class Kind:
    """Type of a dataref: ``int``, ``float``, ``double`` or ``byte``; elements of an array; whether it is writable; X-Plane's complaint
    when it is looked up."""

    type: str
    length: int | None = None
    writable: bool = True
    complaint: str | None = None


class World(Protocol):
    """The simulated world behind the fake."""

    def kind(self, name: str) -> Kind | None: ...
    def get(self, name: str, index: int) -> float: ...
    def set(self, name: str, index: int, value: float) -> None: ...
    def knows_command(self, path: str) -> bool: ...
    def command(self, path: str) -> None: ...
    def world_to_local(self, latitude: float, longitude: float, altitude: float) -> tuple[float, float, float]: ...
    def local_to_world(self, x: float, y: float, z: float) -> tuple[float, float, float]: ...
    def ground_below(self, x: float, y: float, z: float) -> tuple[float, float, float] | None: ...
    def place_user(self, latitude: float, longitude: float, altitude: float, heading: float, speed: float) -> None: ...
    def publish(self, name: str, value: float) -> None: ...
    def begin_frame(self) -> int: ...
    def place_camera(self, position: list[float] | None) -> None: ...
    def lose_camera(self) -> None: ...
    def show_frame(self, rectangles: list[tuple[float, ...]]) -> None: ...
    def others_fly(self) -> bool: ...
    def let_others_fly(self, fly: bool) -> None: ...
    def render(self, width: int, height: int, windows: bool = False) -> bytes: ...
    def system_path(self) -> str: ...


class FakeXpError(AssertionError):
    """The plugin did something that X-Plane does not tolerate."""


def as_float32(value: float) -> float:
    """A number rounded to 32 bits."""
    return struct.unpack("<f", struct.pack("<f", value))[0]


@dataclass
class ProbeInfo:
    """Answer of a terrain probe."""

    result: int
    locationX: float = 0.0
    locationY: float = 0.0
    locationZ: float = 0.0


class FakeXp:
    """Stands in for the module ``xp``. ``quirks`` are those of ``docs/simulator.md`` that concern frames and callbacks."""

    Type_Unknown, Type_Int, Type_Float, Type_Double = 0, 1, 2, 4
    Type_FloatArray, Type_IntArray, Type_Data = 8, 16, 32
    FlightLoop_Phase_BeforeFlightModel, FlightLoop_Phase_AfterFlightModel = 0, 1
    Phase_Window = 50
    ControlCameraUntilViewChanges, ControlCameraForever = 1, 2
    ProbeY = 0
    ProbeHitTerrain, ProbeError, ProbeMissed = 0, 1, 2

    def __init__(self, world: World, quirks: frozenset[str] = frozenset()) -> None:
        self.world = world
        self.quirks = quirks
        self.lines: list[str] = []
        self.flushed_lines = 0
        # Whether anybody looks at the frames, and what was drawn over this one: left, bottom, right, top, red, green, blue,
        # and whether that was after the windows.
        self.shows_frames = False
        self.rectangles: list[tuple[float, ...]] = []
        self.cycle = 0
        # Names that were looked up, calls from a place that is forbidden to them, and places where every call fails.
        self.looked_up: set[str] = set()
        self.misplaced: list[tuple[str, str]] = []
        self.failing: set[str] = set()
        # The callback in progress; None while no plugin is called, as in a test's own code.
        self._place: str | None = None
        self._thread = threading.get_ident()
        self._frames = 0
        # Callback and phase.
        self._loops: dict[int, tuple[Callable[..., float], int]] = {}
        self._scheduled: set[int] = set()
        self._camera: tuple[Callable[..., int], Any] | None = None
        self._draws: list[tuple[Callable[..., int], int, int, Any]] = []
        self._accessors: dict[int, tuple[str, Callable[[Any], float], Any]] = {}
        self._planes: tuple[Any, Any] | None = None
        self._next_id = 1
        self._windows = False

    # What the host does.

    def frame(self) -> None:
        """One frame of the simulator: flight loops before and after the flight model, camera, drawing."""
        self._frames += 1
        self.rectangles.clear()
        two_cycles = "two_cycles_per_loop" in self.quirks
        camera_first = "camera_callback_order" in self.quirks and self._frames % 2 == 0
        frame = self.world.begin_frame()
        self.cycle = 2 * frame if two_cycles else frame
        self._run_loops(self.FlightLoop_Phase_BeforeFlightModel)
        if camera_first:
            self._run_camera()
        self._run_loops(self.FlightLoop_Phase_AfterFlightModel)
        if two_cycles:
            self.cycle += 1
        if not camera_first:
            self._run_camera()
        # SDK: 1 is before the phase, 0 after it. Callbacks after the phase find the windows drawn.
        for when in (1, 0) if "draw_before_is_one" in self.quirks else (0, 1):
            for callback, phase, registered, refcon in list(self._draws):
                if registered == when:
                    with self.inside(rules.DRAW):
                        callback(phase, when, refcon)
            self._windows = True
        self._windows = False
        if self.shows_frames:
            self.world.show_frame(self.rectangles)
        for name, read, refcon in self._accessors.values():
            with self.inside(rules.ACCESSOR):
                value = read(refcon)
            self.world.publish(name, value)

    @contextlib.contextmanager
    def inside(self, place: str) -> Iterator[None]:
        """X-Plane calls the plugin from this place."""
        outer, self._place = self._place, place
        try:
            yield
        finally:
            self._place = outer

    def disable(self, plugin: Any) -> None:
        """Disables the plugin's interface, as X-Plane does at its end and when Python plugins are reloaded."""
        self._must_not_hang()
        with self.inside(rules.DISABLE):
            plugin.XPluginDisable()
        if self._loops or self._draws or self._camera is not None:
            raise FakeXpError("a plugin that is disabled left flight loops, draw callbacks or the camera")

    def _must_not_hang(self) -> None:
        """X-Plane 12 hangs for ever if planes are released, or their plugin disabled, while other aircraft are defined."""
        if self._planes is not None and self.world.others_fly() and not self.is_x_plane_11:
            self.misplaced.append(("releasePlanes", "while other aircraft are defined"))
            raise FakeXpError("planes are given up while other aircraft are defined: X-Plane 12 hangs")

    @property
    def is_x_plane_11(self) -> bool:
        """Whether the world is X-Plane 11's."""
        return self.world.get("sim/version/xplane_internal_version", 0) < 120_000

    def steal_camera(self) -> None:
        """As a view key does: the current camera callback is notified, and not called again."""
        if self._camera is not None:
            callback, refcon = self._camera
            self._camera = None
            self.world.lose_camera()
            with self.inside(rules.CAMERA):
                callback(None, 1, refcon)

    def _run_loops(self, phase: int) -> None:
        place = rules.BEFORE if phase == self.FlightLoop_Phase_BeforeFlightModel else rules.AFTER
        for loop in [l for l in self._loops if l in self._scheduled]:
            if loop not in self._loops or self._loops[loop][1] != phase:
                continue
            with self.inside(place):
                if self._loops[loop][0](0.016, 0.016, self.cycle, None) == 0:
                    self._scheduled.discard(loop)

    def must_be_drawing(self) -> None:
        """OpenGL exists in draw callbacks only."""
        self._here()
        if self._place != rules.DRAW:
            raise FakeXpError("OpenGL is called outside a draw callback")

    @property
    def windows_drawn(self) -> bool:
        """Whether the windows of the user interface cover what is read back now."""
        return self._windows

    def _run_camera(self) -> None:
        position = None
        if self._camera is not None:
            callback, refcon = self._camera
            asked = [0.0] * 7
            # Only changes to this very list count.
            with self.inside(rules.CAMERA):
                answer = callback(asked, 0, refcon)
            if answer == 1:
                position = [as_float32(value) for value in asked]
            elif "camera_taken" in self.quirks and self._camera == (callback, refcon):
                # A callback that returns 0 gives up the camera.
                self._camera = None
        self.world.place_camera(position)

    def _here(self, function: str = "") -> None:
        """Checks from where a function is called."""
        if threading.get_ident() != self._thread:
            self.misplaced.append((function or "a function", "another thread"))
            raise FakeXpError("xp is called from a thread that is not X-Plane's")
        if self._place in self.failing:
            raise RuntimeError(f"injected into {self._place}")
        if self._place is not None and self._place not in rules.PLACES.get(function, (self._place,)):
            self.misplaced.append((function, self._place))
            raise FakeXpError(f"{function} is called from {self._place}: X-Plane does not allow that")

    def _new_id(self) -> int:
        self._next_id += 1
        return self._next_id

    # What XPPython3 offers.

    def log(self, text: str) -> None:
        """An empty text flushes the file."""
        if threading.get_ident() != self._thread:
            raise FakeXpError("xp is called from a thread that is not X-Plane's")
        if text:
            self.lines.append(text)
        else:
            self.flushed_lines = len(self.lines)

    def getCycleNumber(self) -> int:
        self._here()
        return self.cycle

    def getSystemPath(self) -> str:
        self._here()
        return self.world.system_path()

    def getVersions(self) -> tuple[int, int, int]:
        """X-Plane's version in five digits, 12430 for 12.4.3; the SDK's; the host application, 1 for X-Plane."""
        self._here()
        internal = int(self.world.get("sim/version/xplane_internal_version", 0))
        return (internal // 100 * 10 if internal >= 120_000 else internal // 10), 411, 1

    def countAircraft(self) -> tuple[int, int, int]:
        """Aircraft that exist, those that fly, and the plugin that controls the others."""
        self._here("countAircraft")
        return 20, 2 if self.world.others_fly() else 1, -1 if self._planes is None else 1

    def acquirePlanes(self, aircraft: Any = None, callback: Any = None, refCon: Any = None) -> int:
        self._here("acquirePlanes")
        self._planes = (callback, refCon)
        return 1

    def releasePlanes(self) -> None:
        self._here("releasePlanes")
        self._must_not_hang()
        self._planes = None

    def setActiveAircraftCount(self, count: int) -> None:
        self._here("setActiveAircraftCount")
        if self._planes is None:
            raise FakeXpError("the number of aircraft is set without having acquired them")
        self.world.let_others_fly(count > 1)

    def findDataRef(self, name: str) -> Any:
        self._here()
        kind = self.world.kind(name)
        if name not in self.looked_up and kind is not None and kind.complaint is not None:
            # X-Plane knows the plugin that runs all of Python's.
            self._write_system_log(f"[XPPython3]: {kind.complaint}")
        self.looked_up.add(name)
        return None if kind is None else (name, kind)

    def _write_system_log(self, line: str) -> None:
        with Path(self.world.system_path(), "Log.txt").open("a", encoding="utf-8") as log:
            log.write(f"{line}\n")

    def getDataRefTypes(self, ref: Any) -> int:
        _, kind = ref
        if kind.type == "byte":
            return self.Type_Data
        if kind.length is not None:
            return self.Type_IntArray if kind.type == "int" else self.Type_FloatArray
        return {"int": self.Type_Int, "float": self.Type_Float, "double": self.Type_Double | self.Type_Float}[kind.type]

    def _get(self, ref: Any, types: tuple[str, ...]) -> float:
        self._here()
        name, kind = ref
        if kind.length is not None or kind.type not in types:
            raise FakeXpError(f"{name} is read as {types}, but is {kind}")
        return self.world.get(name, 0)

    def _set(self, ref: Any, types: tuple[str, ...], value: float) -> None:
        self._here("set")
        name, kind = ref
        if kind.length is not None or kind.type not in types:
            raise FakeXpError(f"{name} is written as {types}, but is {kind}")
        if kind.writable:
            self.world.set(name, 0, value if kind.type == "double" else as_float32(value))

    def getDatai(self, ref: Any) -> int:
        return int(self._get(ref, ("int",)))

    def getDataf(self, ref: Any) -> float:
        return as_float32(self._get(ref, ("float", "double")))

    def getDatad(self, ref: Any) -> float:
        return self._get(ref, ("double",))

    def setDatai(self, ref: Any, value: int) -> None:
        if not isinstance(value, int):
            raise FakeXpError(f"{ref[0]} is set to {value!r}, which is no int")
        self._set(ref, ("int",), value)

    def setDataf(self, ref: Any, value: float) -> None:
        self._set(ref, ("float",), value)

    def setDatad(self, ref: Any, value: float) -> None:
        self._set(ref, ("double",), value)

    def _get_array(self, ref: Any, values: list[Any] | None, offset: int, count: int) -> int:
        self._here()
        name, kind = ref
        if kind.length is None:
            raise FakeXpError(f"{name} is no array")
        if values is None:
            return kind.length
        end = min(kind.length, offset + (kind.length if count < 0 else count))
        values[:] = [as_float32(self.world.get(name, index)) for index in range(offset, end)]
        return len(values)

    def getDatavf(self, ref: Any, values: list[float] | None = None, offset: int = 0, count: int = -1) -> int:
        return self._get_array(ref, values, offset, count)

    def getDatavi(self, ref: Any, values: list[int] | None = None, offset: int = 0, count: int = -1) -> int:
        return self._get_array(ref, values, offset, count)

    def getDatas(self, ref: Any, offset: int = 0, count: int = -1) -> str:
        self._here()
        name, kind = ref
        if kind.type != "byte":
            raise FakeXpError(f"{name} is read as a text, but is {kind}")
        end = kind.length if count < 0 else min(kind.length, offset + count)
        read = bytes(int(self.world.get(name, index)) for index in range(offset, end))
        return read.split(b"\0")[0].decode()

    def _set_array(self, ref: Any, values: list[Any], offset: int, count: int) -> None:
        self._here("set")
        name, kind = ref
        if kind.length is None:
            raise FakeXpError(f"{name} is no array")
        for index, value in enumerate(values[: len(values) if count < 0 else count], offset):
            if kind.writable and index < kind.length:
                self.world.set(name, index, as_float32(value))

    def setDatavf(self, ref: Any, values: list[float], offset: int = 0, count: int = -1) -> None:
        self._set_array(ref, values, offset, count)

    def setDatavi(self, ref: Any, values: list[int], offset: int = 0, count: int = -1) -> None:
        self._set_array(ref, values, offset, count)

    def registerDataAccessor(
        self,
        name: str,
        dataType: int = 0,
        writable: int = -1,
        readInt: Callable[[Any], int] | None = None,
        writeInt: Any = None,
        readFloat: Callable[[Any], float] | None = None,
        writeFloat: Any = None,
        readRefCon: Any = None,
    ) -> int:
        self._here("registerDataAccessor")
        read = readFloat or readInt
        if read is None:
            raise FakeXpError(f"{name} cannot be read")
        accessor = self._new_id()
        self._accessors[accessor] = (name, read, readRefCon)
        return accessor

    def unregisterDataAccessor(self, accessor: int) -> None:
        self._here("unregisterDataAccessor")
        del self._accessors[accessor]

    def createFlightLoop(self, callback: Callable[..., float], phase: int = 0, refCon: Any = None) -> int:
        self._here("createFlightLoop")
        loop = self._new_id()
        self._loops[loop] = (callback, phase)
        return loop

    def scheduleFlightLoop(self, flightLoopID: int, interval: float = 0.0, relativeToNow: int = 1) -> None:
        self._here("scheduleFlightLoop")
        self._scheduled.add(flightLoopID)

    def destroyFlightLoop(self, flightLoopID: int) -> None:
        self._here("destroyFlightLoop")
        del self._loops[flightLoopID]
        self._scheduled.discard(flightLoopID)

    def controlCamera(self, howLong: int, callback: Callable[..., int], refCon: Any = None) -> None:
        """Whoever had the camera is told so, even if it is the same callback."""
        self._here("controlCamera")
        former, self._camera = self._camera, (callback, refCon)
        if former is not None:
            with self.inside(rules.CAMERA):
                former[0](None, 1, former[1])

    def dontControlCamera(self) -> None:
        self._here("dontControlCamera")
        self._camera = None

    def isCameraBeingControlled(self) -> int:
        self._here()
        return 0 if self._camera is None else self.ControlCameraForever

    def registerDrawCallback(self, callback: Callable[..., int], phase: int, after: int, refCon: Any) -> int:
        self._here("registerDrawCallback")
        if phase != self.Phase_Window:
            raise FakeXpError(f"phase {phase} is not drawn in any X-Plane since 11.50")
        self._draws.append((callback, phase, after, refCon))
        return 1

    def unregisterDrawCallback(self, callback: Callable[..., int], phase: int, after: int, refCon: Any) -> int:
        self._here("unregisterDrawCallback")
        self._draws.remove((callback, phase, after, refCon))
        return 1

    def setGraphicsState(self, *_state: int) -> None:
        self.must_be_drawing()

    def getScreenSize(self) -> tuple[int, int]:
        size = (self.world.get(f"sim/graphics/view/window_{side}", 0) for side in ("width", "height"))
        width, height = size
        return int(width), int(height)

    def getAllMonitorBoundsGlobal(self, bounds: Callable[..., None], refCon: Any) -> None:
        """None: X-Plane runs in a window."""

    def getAllMonitorBoundsOS(self, bounds: Callable[..., None], refCon: Any) -> None:
        bounds(0, 0, 1440, 2560, 0, refCon)

    def worldToLocal(self, latitude: float, longitude: float, altitude: float) -> tuple[float, float, float]:
        self._here()
        return self.world.world_to_local(latitude, longitude, altitude)

    def localToWorld(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        self._here()
        return self.world.local_to_world(x, y, z)

    def placeUserAtLocation(
        self, latitude: float, longitude: float, elevation: float, heading: float, speed: float
    ) -> None:
        self._here("placeUserAtLocation")
        if "late_start_crashes" in self.quirks and self._place != rules.BEFORE:
            raise FakeXpError("a flight is started outside the flight loops before the flight model: X-Plane crashes")
        self.world.place_user(latitude, longitude, as_float32(elevation), as_float32(heading), as_float32(speed))

    def createProbe(self, probeType: int) -> int:
        self._here("createProbe")
        return self._new_id()

    def destroyProbe(self, probe: int) -> None:
        self._here("destroyProbe")

    def probeTerrainXYZ(self, probe: int, x: float, y: float, z: float) -> ProbeInfo:
        self._here("probeTerrainXYZ")
        hit = self.world.ground_below(x, y, z)
        return ProbeInfo(self.ProbeMissed) if hit is None else ProbeInfo(self.ProbeHitTerrain, *hit)

    def findCommand(self, path: str) -> str | None:
        self._here()
        self.looked_up.add(path)
        return path if self.world.knows_command(path) else None

    def commandOnce(self, command: str) -> None:
        self._here("commandOnce")
        self.world.command(command)

    def degTrueToDegMagnetic(self, degrees: float) -> float:
        self._here()
        return degrees


class GetString:
    """Stands in for a function of a library, whose result has a type."""

    restype: Any = None

    def __call__(self, what: int) -> bytes:
        if what != 0x1F01:
            raise FakeXpError(f"glGetString({what:#x})")
        return b"zink (the stand-in)"


class FakeGl:
    """Stands in for the OpenGL library: pixels come from the world, filled rectangles are recorded."""

    def __init__(self, xp: FakeXp) -> None:
        self._xp = xp
        self.glGetString = GetString()
        self._colour = (0, 0, 0)
        # left, bottom, right, top, colour
        self.filled: list[tuple[float, float, float, float, tuple[int, int, int]]] = []

    def glGetIntegerv(self, what: int, out: Any) -> None:
        self._xp.must_be_drawing()
        if what != 0x0BA2:
            raise FakeXpError(f"glGetIntegerv({what:#x})")
        out[0], out[1] = 0, 0
        out[2], out[3] = self._xp.getScreenSize()

    def glGetError(self) -> int:
        return 0

    def glPixelStorei(self, _name: int, value: int) -> None:
        self._alignment = value

    def glReadPixels(self, x: int, y: int, width: int, height: int, form: int, kind: int, pixels: Any) -> None:
        self._xp.must_be_drawing()
        if (form, kind, self._alignment) != (0x1907, 0x1401, 1):
            raise FakeXpError(f"glReadPixels of form {form:#x}, type {kind:#x}, alignment {self._alignment}")
        rgb, row = self._xp.world.render(width, height, self._xp.windows_drawn), width * 3
        # The lowest row first.
        pixels.raw = b"".join(rgb[at : at + row] for at in range((height - 1) * row, -1, -row)) + b"\0" * (
            len(pixels.raw) - len(rgb)
        )

    def glColor3ub(self, red: Any, green: Any, blue: Any) -> None:
        self._xp.must_be_drawing()
        self._colour = (red.value, green.value, blue.value)

    def glRectf(self, left: Any, bottom: Any, right: Any, top: Any) -> None:
        self._xp.must_be_drawing()
        edges = (left.value, bottom.value, right.value, top.value)
        self.filled.append((*edges, self._colour))
        # With the callbacks in the other order nothing tells what lies over what: what plugins draw does, as in X-Plane.
        is_over = self._xp.windows_drawn or "draw_before_is_one" not in self._xp.quirks
        self._xp.rectangles.append((*edges, *self._colour, float(is_over)))
