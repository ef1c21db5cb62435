"""Headers of the link as typed, checked values: what a client requests, and why it is rejected. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Mapping

MAX_PICTURE_SIDE_PX = 8192
# Of an aircraft or the ground; of anything of an approach from its runway; of any angle, which may have turned more than once.
ALTITUDES_M = (-500.0, 30_000.0)
LENGTHS_M = (-1e6, 1e6)
ANGLES_DEG = (-720.0, 720.0)
ILS_FREQUENCIES_MHZ = (108.0, 112.0)
# Captures that are shown for one drawn frame.
CODED = ("coded", "probe")


class Refusal(Exception):
    """Why a request is answered by ``error``, as a sentence."""

    repeats = False


class LastingRefusal(Refusal):
    """Why a request cannot be met, however often it is sent."""

    repeats = True


@dataclass(frozen=True)
class Pose:
    """Position and attitude of a body: WGS-84, metres above sea level, degrees true, nose up, right wing down."""

    latitude_deg: float
    longitude_deg: float
    altitude_msl_m: float
    heading_true_deg: float
    pitch_deg: float
    roll_deg: float

    def header(self) -> dict[str, float]:
        """As in the link."""
        return dict(vars(self))


@dataclass(frozen=True)
class Runway:
    """The parts of a runway that an approach needs."""

    name: str
    latitude_deg: float
    longitude_deg: float
    altitude_msl_m: float
    course_true_deg: float
    glide_path_deg: float
    touchdown_past_threshold_m: float
    ils_frequency_mhz: float | None
    course_magnetic_deg: float | None


@dataclass(frozen=True)
class Clock:
    """A moment of the year: the day counted from 1, and seconds since midnight UTC."""

    day_of_year: int
    zulu_time_s: float


@dataclass(frozen=True)
class Capture:
    """One view of one tick."""

    tick: int
    view: int
    pose: Pose
    flap_ratio: float
    gear_ratio: float
    camera: Pose
    hfov_deg: float
    width_px: int
    height_px: int
    # "picture": read back; "drawn": on the screen; "coded": on the screen for one frame, with its number; "probe": the same with the
    # aircraft in a wrong place, to measure the lag of the scene.
    deliver: str
    # Of the window around the picture: left and right, above and below.
    margin_x_px: int = 0
    margin_y_px: int = 0


@dataclass(frozen=True)
class Profile:
    """The vertical plan: ``kind`` and its altitudes, metres above sea level."""

    kind: str
    start_altitude_msl_m: float
    lower_altitude_msl_m: float | None = None
    step_from_threshold_m: float | None = None


@dataclass(frozen=True)
class Start:
    """Where and how a flight begins."""

    pose: Pose
    speed_mps: float


@dataclass(frozen=True)
class Fly:
    """A live approach."""

    start: Start
    runway: Runway
    profile: Profile
    time_limit_s: float
    already_started: bool


def number(header: Mapping[str, Any], key: str, low: float = -math.inf, high: float = math.inf) -> float:
    """A finite number within bounds."""
    value = header.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise LastingRefusal(f"{key} is {value!r}, expected a number")
    if not low <= value <= high:
        raise LastingRefusal(f"{key} is {value}, expected {low} to {high}")
    return float(value)


def whole(header: Mapping[str, Any], key: str, low: int, high: int) -> int:
    """A whole number within bounds."""
    value = header.get(key)
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise LastingRefusal(f"{key} is {value!r}, expected a whole number from {low} to {high}")
    return value


def part(header: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """An object within the header."""
    value = header.get(key)
    if not isinstance(value, dict):
        raise LastingRefusal(f"{key} is {value!r}, expected an object")
    return value


def place(header: Mapping[str, Any]) -> tuple[float, float]:
    """Latitude and longitude."""
    return number(header, "latitude_deg", -90, 90), number(header, "longitude_deg", -360, 360)


def pose(header: Mapping[str, Any]) -> Pose:
    """A pose on earth."""
    latitude, longitude = place(header)
    return Pose(
        latitude,
        longitude,
        number(header, "altitude_msl_m", -1e6, 1e6),
        number(header, "heading_true_deg", *ANGLES_DEG),
        number(header, "pitch_deg", *ANGLES_DEG),
        number(header, "roll_deg", *ANGLES_DEG),
    )


def margins(header: Mapping[str, Any]) -> tuple[int, int]:
    """The window's margins around the image, by a ``freeze`` request."""
    value = header.get("margins_px", [0, 0])
    if not isinstance(value, list) or len(value) != 2:
        raise LastingRefusal(f"margins_px is {value!r}, expected two numbers")
    left, top = (whole({"margins_px": side}, "margins_px", 0, MAX_PICTURE_SIDE_PX) for side in value)
    return left, top


def capture(header: Mapping[str, Any], margins_px: tuple[int, int] = (0, 0)) -> Capture:
    """A ``capture`` request for an image in the middle of a window with these margins."""
    camera, controls = part(header, "camera"), part(header, "controls")
    deliver = header.get("deliver", "picture")
    if deliver not in ("picture", "drawn", *CODED):
        raise LastingRefusal(f"deliver is {deliver!r}, expected picture, drawn, coded or probe")
    hfov_deg = number(camera, "hfov_deg")
    if not 0 < hfov_deg < 180:
        raise LastingRefusal(f"hfov_deg is {hfov_deg}, expected more than 0 and less than 180")
    return Capture(
        tick=whole(header, "tick", 0, 2**32 - 1),
        view=whole(header, "view", 0, 2**32 - 1),
        pose=pose(part(header, "pose")),
        flap_ratio=number(controls, "flap_ratio", 0, 1),
        gear_ratio=number(controls, "gear_ratio", 0, 1),
        camera=pose(camera),
        hfov_deg=hfov_deg,
        width_px=whole(header, "width_px", 1, MAX_PICTURE_SIDE_PX),
        height_px=whole(header, "height_px", 1, MAX_PICTURE_SIDE_PX),
        deliver=deliver,
        margin_x_px=margins_px[0],
        margin_y_px=margins_px[1],
    )


def clock(header: Mapping[str, Any]) -> Clock:
    """A clock."""
    return Clock(whole(header, "day_of_year", 1, 366), number(header, "zulu_time_s", 0, 86_400))


def runway(header: Mapping[str, Any]) -> Runway:
    """A runway."""
    threshold = part(header, "threshold")
    latitude, longitude = place(threshold)
    optional = {
        key: None if header.get(key) is None else number(header, key, *limits)
        for key, limits in (("ils_frequency_mhz", ILS_FREQUENCIES_MHZ), ("course_magnetic_deg", ANGLES_DEG))
    }
    return Runway(
        name=f"{header.get('airport')} {header.get('name')}",
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_msl_m=number(threshold, "altitude_msl_m", *ALTITUDES_M),
        course_true_deg=number(header, "course_true_deg", *ANGLES_DEG),
        glide_path_deg=number(header, "glide_path_deg", 0.5, 15),
        touchdown_past_threshold_m=number(header, "touchdown_past_threshold_m", *LENGTHS_M),
        **optional,
    )


def profile(header: Mapping[str, Any]) -> Profile:
    """The vertical plan of an approach."""
    kind = header.get("kind")
    if kind == "glide_path":
        return Profile(kind, number(header, "level_altitude_msl_m", *ALTITUDES_M))
    if kind == "step_down":
        return Profile(
            kind,
            number(header, "upper_altitude_msl_m", *ALTITUDES_M),
            number(header, "lower_altitude_msl_m", *ALTITUDES_M),
            number(header, "step_from_threshold_m", *LENGTHS_M),
        )
    if kind == "continuous_descent":
        return Profile(kind, number(header, "start_altitude_msl_m", *ALTITUDES_M))
    raise LastingRefusal(f"profile is {kind!r}, expected glide_path, step_down or continuous_descent")


def start(header: Mapping[str, Any]) -> Start:
    """A start in the air."""
    position = part(header, "position")
    latitude, longitude = place(position)
    where = Pose(
        latitude,
        longitude,
        number(position, "altitude_msl_m", *ALTITUDES_M),
        number(header, "heading_true_deg", *ANGLES_DEG),
        0.0,
        0.0,
    )
    # An aircraft put into the air at rest would fall.
    return Start(where, number(header, "speed_mps", 30, 400))


def fly(header: Mapping[str, Any]) -> Fly:
    """A ``fly`` request. Its seed has no meaning in X-Plane."""
    return Fly(
        start=start(part(header, "start")),
        runway=runway(part(header, "runway")),
        profile=profile(part(header, "profile")),
        time_limit_s=number(header, "time_limit_s", 1, 86_400),
        already_started=header.get("already_started", False) is True,
    )
