"""A live approach: into the air, down by X-Plane's autopilot, every frame logged with all the bits there are.

Written as a generator like ``capture``: each ``yield`` is one more frame of X-Plane.
"""

from __future__ import annotations

import math
import struct
import time
from typing import Any, Generator

from . import autopilot, datarefs as names
from .approach import Dials, before_threshold_m, dials
from .autopilot import Autopilot
from .capture import Answer
from .datarefs import Datarefs
from .local_frame import LocalFrame
from .messages import Fly, Pose, Refusal, Runway
from .stage import Stage

COLUMNS = (
    "time_s", "latitude_deg", "longitude_deg", "altitude_msl_m", "heading_true_deg", "pitch_deg", "roll_deg",
    "velocity_north_mps", "velocity_east_mps", "velocity_down_mps", "true_airspeed_mps", "flap_ratio", "gear_ratio",
    "on_ground",
)  # fmt: skip
ROW = struct.Struct(f"<{len(COLUMNS)}d")

# Scenery around the start: the aircraft is held there for at least so many frames, and until loading ends.
HOLD_FRAMES = 10
LOADING_LIMIT_S = 30.0
# Engines of an air start run at once; a frame or two may pass until X-Plane says so.
ENGINES_LIMIT_S = 10.0
# After a start by X-Plane itself velocities read zero for a while.
FLYING_ABOVE_KT = 50.0
# The rollout belongs to the recording for so long.
AFTER_TOUCHDOWN_S = 3.0
# Touching down farther from the threshold than this is no landing on this runway.
RUNWAY_AROUND_M = 5_000.0


def fly(
    request: Fly, stage: Stage, datarefs: Datarefs, frame: LocalFrame, xp: Any
) -> Generator[None, None, Answer]:
    """Flies the approach and returns its ``flown``."""
    if request.already_started:
        yield from _wait_until_flying(datarefs)
    else:
        yield from _air_start(request, stage, datarefs, frame, xp)
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
    clock = _Clock(datarefs)
    log = bytearray()
    rows, time_s, touchdown_s = 0, 0.0, None
    while touchdown_s is None or time_s < touchdown_s + AFTER_TOUCHDOWN_S:
        row = _row(time_s, stage, datarefs, frame)
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
        yield
        # A frame in which no simulated time passed (a pause) has no state of its own.
        while not clock.has_advanced():
            yield
        time_s = clock.elapsed_s
    return {"message": "flown", "columns": list(COLUMNS), "rows": rows}, bytes(log)


class _Clock:
    """X-Plane's own time of the flight. Lengths of frames are not added up: what X-Plane says of them is rounded, and is not the
    time by which it moved the aircraft when frames are slow."""

    def __init__(self, datarefs: Datarefs) -> None:
        self._datarefs = datarefs
        self._first_s = self._now_s = datarefs.get(names.FLIGHT_TIME_S)

    @property
    def elapsed_s(self) -> float:
        """Simulated time since this was made, as of the last look."""
        return self._now_s - self._first_s

    def has_advanced(self) -> bool:
        """Looks again; whether time has passed since the last look."""
        before_s, self._now_s = self._now_s, self._datarefs.get(names.FLIGHT_TIME_S)
        if self._now_s < before_s:
            raise Refusal(
                f"X-Plane began another flight in the middle of this one ({names.FLIGHT_TIME_S} fell from {before_s:.1f} s to "
                f"{self._now_s:.1f} s): leave X-Plane alone while it flies"
            )
        return self._now_s > before_s


def _progress(row: tuple[float, ...], runway: Runway) -> tuple[float, float, float]:
    """Of a row: distance before the threshold and altitude in metres, speed over ground."""
    return before_threshold_m(runway, row[1], row[2]), row[3], math.hypot(row[7], row[8])


def _air_start(
    request: Fly, stage: Stage, datarefs: Datarefs, frame: LocalFrame, xp: Any
) -> Generator[None, None, None]:
    """Into the air with the flight model stopped, until the scenery is there; then off with a velocity."""
    start = request.start
    # X-Plane's own air start, for its engines: they run after it even if the aircraft was parked cold. Where it puts the aircraft is
    # rounded to 32 bits and flies on at once, so the place is written again below.
    xp.placeUserAtLocation(
        start.latitude_deg, start.longitude_deg, start.altitude_msl_m, start.heading_true_deg, request.speed_mps
    )
    try:
        deadline = time.monotonic() + LOADING_LIMIT_S
        held = 0
        # The jump makes X-Plane load scenery and move its local origin: written anew, converted anew, each frame.
        while held < HOLD_FRAMES or (stage.scenery_is_loading() and time.monotonic() < deadline):
            # Another flight may have begun with its own overrides.
            datarefs.set(names.OVERRIDE_FLIGHT_MODEL, 1)
            stage.write_pose(start)
            held += 1
            yield
        heading = math.radians(start.heading_true_deg)
        ned = (request.speed_mps * math.cos(heading), request.speed_mps * math.sin(heading), 0.0)
        stage.write_pose(start)
        for name, value in zip(names.LOCAL_VELOCITY, frame.velocity_local(start, ned)):
            datarefs.set(name, value)
        datarefs.set_if_there(names.ROTATION_RATES, 0.0)
    finally:
        datarefs.set(names.OVERRIDE_FLIGHT_MODEL, 0)
    # The jump reads as a crash.
    stage.command("sim/operation/fix_all_systems")
    yield


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


def _wait_until_flying(datarefs: Datarefs) -> Generator[None, None, None]:
    deadline = time.monotonic() + LOADING_LIMIT_S
    while datarefs.get(names.INDICATED_AIRSPEED) < FLYING_ABOVE_KT:
        if time.monotonic() > deadline:
            raise Refusal(
                f"the flight was started, but after {LOADING_LIMIT_S:.0f} s the airspeed is still "
                f"{datarefs.get(names.INDICATED_AIRSPEED):.0f} kt, expected more than {FLYING_ABOVE_KT:.0f}"
            )
        yield


def _tune(runway: Runway, datarefs: Datarefs, xp: Any) -> None:
    """The landing system. Its course is magnetic."""
    if runway.ils_frequency_mhz is not None:
        datarefs.set(names.NAV1_FREQUENCY_10KHZ, round(runway.ils_frequency_mhz * 100))
    course = runway.course_magnetic_deg
    if course is None:
        course = xp.degTrueToDegMagnetic(runway.course_true_deg)
    datarefs.set(names.NAV1_COURSE_MAGNETIC, course)


class _Crew:
    """Sets what has changed, once."""

    def __init__(self, request: Fly, pilot: Autopilot, datarefs: Datarefs) -> None:
        self._request = request
        self._pilot = pilot
        self._datarefs = datarefs
        self._now: Dials | None = None

    def set(self, distance_m: float, altitude_msl_m: float, ground_speed_mps: float) -> None:
        """As the plan of the approach has it for here."""
        wanted = dials(self._request.profile, self._request.runway, distance_m, altitude_msl_m, ground_speed_mps)
        now, self._now = self._now, wanted
        if wanted != now:
            self._change(now, wanted)
        # Switched on, the mode dials the vertical speed of that moment: ours comes after it.
        fpm = wanted.vertical_speed_fpm
        if fpm is not None and not self._pilot.busy and self._datarefs.get(names.VERTICAL_SPEED_FPM) != fpm:
            self._datarefs.set(names.VERTICAL_SPEED_FPM, fpm)

    def _change(self, now: Dials | None, wanted: Dials) -> None:
        if now is None or wanted.speed_kt != now.speed_kt:
            self._datarefs.set(names.AIRSPEED_DIAL_KT, wanted.speed_kt)
        if now is None or wanted.flap_ratio != now.flap_ratio:
            # The handle only: the flaps run out at their own pace.
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
    flaps, gear = datarefs.first(names.FLAPS_NOW), datarefs.first(names.GEAR_NOW)
    return (
        time_s,
        *pose.header().values(),
        *frame.velocity_ned(local, (x, y, z)),
        datarefs.get(names.TRUE_AIRSPEED),
        datarefs.get(flaps) if flaps else 0.0,
        datarefs.get(gear) if gear else 0.0,
        1.0 if datarefs.get(names.ON_GROUND) != 0 else 0.0,
    )
