"""A live approach: into the air, down by X-Plane's autopilot, every frame logged with full precision.

Written as a generator like ``capture``: each ``yield`` is one more frame of X-Plane.
"""

from __future__ import annotations

import math
import struct
import time
from typing import Generator

from . import autopilot, datarefs as names, scenery
from .approach import Dials, before_threshold_m, dials
from .autopilot import Autopilot
from .capture import Answer
from .datarefs import Datarefs
from .found import set_pause
from .local_frame import LocalFrame
from .loops import FlightLoops
from .messages import Fly, Refusal, Runway, Start
from .scenery import Ground
from .stage import Stage
from .traffic import Traffic
from .xp_api import Xp

COLUMNS = (
    "time_s", "latitude_deg", "longitude_deg", "altitude_msl_m", "heading_true_deg", "pitch_deg", "roll_deg",
    "velocity_north_mps", "velocity_east_mps", "velocity_down_mps", "true_airspeed_mps", "flap_ratio", "gear_ratio",
    "on_ground",
)  # fmt: skip
ROW = struct.Struct(f"<{len(COLUMNS)}d")

# X-Plane itself calls a start, from a separate one-shot callback this much later: called from within another it crashed X-Plane at
# times.
START_DELAY_S = 0.5
START_LIMIT_S = 60.0
# Engines of an air start run at once; X-Plane may report that a frame or two later.
ENGINES_LIMIT_S = 10.0
# Dials round.
DIAL_STEP_FT = 1.0
# The recording includes the rollout for this long.
AFTER_TOUCHDOWN_S = 3.0
# Touching down farther from the threshold than this is not a landing on this runway.
RUNWAY_AROUND_M = 5_000.0


class Flights:
    """Starts flights and flies them."""

    def __init__(
        self, stage: Stage, datarefs: Datarefs, frame: LocalFrame, ground: Ground, traffic: Traffic, loops: FlightLoops, xp: Xp
    ) -> None:
        self._stage = stage
        self._datarefs = datarefs
        self._frame = frame
        self._ground = ground
        self._traffic = traffic
        self._loops = loops
        self._xp = xp
        self._sampler = _Sampler(stage, datarefs, frame)

    def sample(self) -> None:
        """After the flight model: the state of this frame, if a flight is logged."""
        self._sampler.sample()

    def travel(self, start: Start, already_started: bool) -> Generator[None, None, Answer]:
        """Starts a flight at a place, once, unless X-Plane has started it there, and holds the aircraft when the scenery has
        loaded."""
        if not already_started:
            yield from self._begin(start)
        yield from self._arrive(start)
        return {"message": "arrived"}, b""

    def fly(self, request: Fly) -> Generator[None, None, Answer]:
        """Flies the approach and returns its ``flown``."""
        if not request.already_started:
            yield from self.travel(request.start, False)
        self._launch(request.start)
        try:
            return (yield from _fly(request, self._stage, self._datarefs, self._frame, self._sampler, self._xp))
        finally:
            self._sampler.end()

    def _begin(self, start: Start) -> Generator[None, None, None]:
        """X-Plane's own air start, for its engines: they run after it even if the aircraft was parked cold. The position is rounded
        to 32 bits and the aircraft flies on at once, so the place is written again on arrival."""
        xp, pose = self._xp, start.pose
        # A paused X-Plane was seen to ignore a start.
        set_pause(xp, self._datarefs, False)
        outcome: list[Exception | None] = []

        def begin() -> None:
            try:
                xp.placeUserAtLocation(
                    pose.latitude_deg, pose.longitude_deg, pose.altitude_msl_m, pose.heading_true_deg, start.speed_mps
                )
                outcome.append(None)
            except Exception as error:  # For the client.
                outcome.append(error)

        deadline = time.monotonic() + START_LIMIT_S
        try:
            self._loops.once(begin, START_DELAY_S)
            while not outcome:
                if time.monotonic() > deadline:
                    raise Refusal(f"X-Plane did not call the start within {START_LIMIT_S:.0f} s: is a menu or a question open?")
                yield
        finally:
            self._loops.forget()
        if outcome[0] is not None:
            raise Refusal(f"X-Plane cannot begin a flight there: {outcome[0]!r}")

    def _arrive(self, start: Start) -> Generator[None, None, None]:
        """Holds the aircraft at the start until the scenery is there. Converted in each frame: loading moves the local origin."""

        def hold() -> None:
            # Another flight may have begun with its own overrides.
            self._stage.hold()
            self._stage.write_pose(start.pose)

        hold()
        yield
        place = (start.pose.latitude_deg, start.pose.longitude_deg)
        yield from scenery.wait(self._stage, self._ground, place, hold)
        self._traffic.clear()

    def _launch(self, start: Start) -> None:
        """Releases it with a velocity."""
        heading = math.radians(start.pose.heading_true_deg)
        ned = (start.speed_mps * math.cos(heading), start.speed_mps * math.sin(heading), 0.0)
        self._stage.write_pose(start.pose)
        for name, value in zip(names.LOCAL_VELOCITY, self._frame.velocity_local(start.pose, ned)):
            self._datarefs.set(name, value)
        self._stage.let_go()
        # The jump reads as a crash.
        self._stage.command("sim/operation/fix_all_systems")


def _fly(
    request: Fly, stage: Stage, datarefs: Datarefs, frame: LocalFrame, sampler: _Sampler, xp: Xp
) -> Generator[None, None, Answer]:
    """From the launch to the rollout."""
    yield
    yield from _wait_for_engines(datarefs)
    _tune(request.runway, datarefs, xp)
    pilot = Autopilot(stage, datarefs, xp)
    crew = _Crew(request, pilot, datarefs)
    # Only now: an autopilot may refuse to be switched on while the aircraft is parked.
    pilot.want(*autopilot.FROM_SCRATCH)
    crew.set(*_progress(_row(0.0, stage, datarefs, frame), request.runway))
    pilot.step()
    while pilot.busy:
        yield
        pilot.step()
    crew.set(*_progress(_row(0.0, stage, datarefs, frame), request.runway))
    sampler.begin()
    log = bytearray()
    rows, touchdown_s = 0, None
    while True:
        while (row := sampler.take()) is None:
            yield
        time_s = row[0]
        if touchdown_s is not None and time_s >= touchdown_s + AFTER_TOUCHDOWN_S:
            break
        log += ROW.pack(*row)
        rows += 1
        on_ground = row[13] != 0.0
        distance_m, altitude_msl_m, ground_speed_mps = _progress(row, request.runway)
        if on_ground and touchdown_s is None:
            if abs(distance_m) > RUNWAY_AROUND_M:
                raise Refusal(f"the aircraft came down {distance_m:.0f} m before the threshold of {request.runway.name}")
            touchdown_s = time_s
        if touchdown_s is None:
            crew.set(distance_m, altitude_msl_m, ground_speed_mps)
            pilot.step()
        if datarefs.get_or(names.HAS_CRASHED, 0.0) != 0:
            raise Refusal(f"the aircraft crashed {distance_m:.0f} m before the threshold of {request.runway.name}")
        if time_s > request.time_limit_s:
            raise Refusal(
                f"the flight has not landed within {request.time_limit_s:.0f} s; it is {distance_m:.0f} m before the "
                f"threshold of {request.runway.name} at {altitude_msl_m:.0f} m"
            )
    return {"message": "flown", "columns": list(COLUMNS), "rows": rows}, bytes(log)


class _Sampler:
    """The states of a flight, each read after the flight model, where pose and time belong together; taken before the next one."""

    def __init__(self, stage: Stage, datarefs: Datarefs, frame: LocalFrame) -> None:
        self._stage = stage
        self._datarefs = datarefs
        self._frame = frame
        self._clock: _Clock | None = None
        self._row: tuple[float, ...] | None = None
        self._refusal: Refusal | None = None

    def begin(self) -> None:
        """From the next frame on; its time is 0."""
        self.end()
        self._clock = _Clock(self._datarefs)

    def end(self) -> None:
        """No more."""
        self._clock = self._row = self._refusal = None

    def sample(self) -> None:
        """Reads this frame's state. A frame in which no simulated time passed (a pause) has none of its own."""
        if self._clock is None or self._refusal is not None:
            return
        try:
            if self._clock.has_advanced():
                self._row = _row(self._clock.elapsed_s, self._stage, self._datarefs, self._frame)
        except Refusal as refusal:
            self._refusal = refusal

    def take(self) -> tuple[float, ...] | None:
        """The state since the last call, if there was one."""
        if self._refusal is not None:
            raise self._refusal
        row, self._row = self._row, None
        return row


class _Clock:
    """X-Plane's own time of the flight. Frame lengths are not added up: X-Plane reports them rounded, and with slow frames they
    differ from the time by which it moved the aircraft."""

    def __init__(self, datarefs: Datarefs) -> None:
        self._datarefs = datarefs
        self._first_s: float | None = None
        self._now_s = datarefs.get(names.FLIGHT_TIME_S)

    @property
    def elapsed_s(self) -> float:
        """Simulated time from the first update to the last one."""
        return 0.0 if self._first_s is None else self._now_s - self._first_s

    def has_advanced(self) -> bool:
        """Updates; returns whether time has passed since the last update. The first one counts in any case."""
        before_s, self._now_s = self._now_s, self._datarefs.get(names.FLIGHT_TIME_S)
        if self._now_s < before_s:
            raise Refusal(
                f"X-Plane began another flight in the middle of this one ({names.FLIGHT_TIME_S} fell from {before_s:.1f} s to "
                f"{self._now_s:.1f} s): leave X-Plane alone while it flies"
            )
        if self._first_s is None:
            self._first_s = self._now_s
            return True
        return self._now_s > before_s


def _progress(row: tuple[float, ...], runway: Runway) -> tuple[float, float, float]:
    """Of a row: distance before the threshold and altitude in metres, speed over ground."""
    return before_threshold_m(runway, row[1], row[2]), row[3], math.hypot(row[7], row[8])


def _wait_for_engines(datarefs: Datarefs) -> Generator[None, None, None]:
    """Without engines it would be a glider that comes down somewhere."""
    if not datarefs.has(names.ENGINES_RUNNING):
        return
    count = max(1, int(datarefs.get_or(names.ENGINE_COUNT, 1.0)))
    deadline = time.monotonic() + ENGINES_LIMIT_S
    while stopped := [at + 1 for at in range(count) if datarefs.get(f"{names.ENGINES_RUNNING}[{at}]") == 0]:
        if time.monotonic() > deadline:
            raise Refusal(
                f"the aircraft is in the air, but of its {count} engines these do not run: {', '.join(map(str, stopped))}. "
                "Start them in X-Plane (or set it to start with engines running), and see that there is fuel"
            )
        yield


def _tune(runway: Runway, datarefs: Datarefs, xp: Xp) -> None:
    """The landing system, and the autopilot's source. Its course is magnetic."""
    datarefs.set_if_there((names.AUTOPILOT_ELECTRIC_MASTER,), 1)
    datarefs.set_if_there((names.HSI_SOURCE, names.AIRSPEED_IS_MACH), 0)
    if runway.ils_frequency_mhz is not None:
        datarefs.set(names.NAV1_FREQUENCY_10KHZ, round(runway.ils_frequency_mhz * 100))
    course = runway.course_magnetic_deg
    if course is None:
        course = xp.degTrueToDegMagnetic(runway.course_true_deg)
    datarefs.set(names.NAV1_COURSE_MAGNETIC, course)
    datarefs.set_if_there((names.HEADING_BUG_MAGNETIC,), course)


class _Crew:
    """Sets what has changed, once."""

    def __init__(self, request: Fly, pilot: Autopilot, datarefs: Datarefs) -> None:
        self._request = request
        self._pilot = pilot
        self._datarefs = datarefs
        self._now: Dials | None = None

    def set(self, distance_m: float, altitude_msl_m: float, ground_speed_mps: float) -> None:
        """As planned for the current position."""
        wanted = dials(self._request.profile, self._request.runway, distance_m, altitude_msl_m, ground_speed_mps)
        now, self._now = self._now, wanted
        if wanted != now:
            self._change(now, wanted)
        if self._pilot.busy:
            return
        # When switched on, a mode captures the current vertical speed or altitude: ours are set afterwards.
        fpm = wanted.vertical_speed_fpm
        if fpm is not None and self._datarefs.get(names.VERTICAL_SPEED_FPM) != fpm:
            self._datarefs.set(names.VERTICAL_SPEED_FPM, fpm)
        if abs(self._datarefs.get(names.ALTITUDE_DIAL_FT) - wanted.altitude_ft) > DIAL_STEP_FT:
            self._datarefs.set(names.ALTITUDE_DIAL_FT, wanted.altitude_ft)

    def _change(self, now: Dials | None, wanted: Dials) -> None:
        if now is None or wanted.speed_kt != now.speed_kt:
            self._datarefs.set(names.AIRSPEED_DIAL_KT, wanted.speed_kt)
        if now is None or wanted.flap_ratio != now.flap_ratio:
            # The handle only: the flaps extend at their own pace.
            self._datarefs.set_if_there(names.FLAPS_WANTED, wanted.flap_ratio)
        if now is None or wanted.gear_down != now.gear_down:
            self._datarefs.set_if_there(names.GEAR_WANTED, 1.0 if wanted.gear_down else 0.0)
        if now is None or wanted.altitude_ft != now.altitude_ft:
            self._datarefs.set(names.ALTITUDE_DIAL_FT, wanted.altitude_ft)
            if wanted.vertical_speed_fpm is None:
                self._pilot.want(autopilot.ALTITUDE_HOLD)
        if wanted.vertical_speed_fpm is not None and (now is None or now.vertical_speed_fpm is None):
            self._pilot.want(autopilot.VERTICAL_SPEED)
        if wanted.glide_slope and (now is None or not now.glide_slope):
            self._pilot.want(*autopilot.CAPTURE)


def _row(time_s: float, stage: Stage, datarefs: Datarefs, frame: LocalFrame) -> tuple[float, ...]:
    """The state of this frame, in the order of COLUMNS."""
    local = stage.read_local_pose()
    pose = frame.read(local)
    x, y, z = (datarefs.get(name) for name in names.LOCAL_VELOCITY)
    return (
        time_s,
        *pose.header().values(),
        *frame.velocity_ned(local, (x, y, z)),
        datarefs.get(names.TRUE_AIRSPEED),
        datarefs.get_or(names.FLAPS_NOW, 0.0),
        datarefs.get_or(names.GEAR_NOW, 0.0),
        1.0 if datarefs.get(names.ON_GROUND) != 0 else 0.0,
    )
