"""What to dial and lower, and when, on the way down. Pure: distances and altitudes in, settings out.

Laterally the autopilot follows the localizer. Vertically it holds an altitude or a vertical speed until the glide path is to be
captured, which the plan of the approach decides. Speeds, flaps and gear are those of a Boeing 737-800 by distance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from .messages import Profile, Runway

FEET_PER_METER = 1 / 0.3048
FPM_PER_MPS = FEET_PER_METER * 60
# Distance before the threshold (metres), knots from there on.
SPEED_KT = ((math.inf, 180.0), (14_000.0, 160.0), (11_000.0, 145.0), (8_000.0, 138.0))
FLAP_RATIO = ((math.inf, 0.25), (15_000.0, 0.375), (13_000.0, 0.625), (12_000.0, 0.75))
GEAR_DOWN_FROM_M = 14_800.0
# The step of a step-down approach descends faster than the glide path, about 4 degrees at 160 kt.
STEP_DESCENT_FPM = -1_100.0
# The glide path is left to the autopilot once the aircraft is this close to level flight.
LEVEL_WITHIN_M = 30.0
# Earth radius, for the distance to the threshold: a sphere is accurate enough for schedules.
METERS_PER_DEGREE = 111_320.0


@dataclass(frozen=True)
class Dials:
    """The crew's settings. ``None``: not touched."""

    speed_kt: float
    flap_ratio: float
    gear_down: bool
    altitude_ft: float
    vertical_speed_fpm: float | None
    glide_slope: bool


def before_threshold_m(runway: Runway, latitude_deg: float, longitude_deg: float) -> float:
    """Remaining distance along the course, metres; negative past the threshold."""
    north = (runway.latitude_deg - latitude_deg) * METERS_PER_DEGREE
    east = (runway.longitude_deg - longitude_deg) * METERS_PER_DEGREE * math.cos(math.radians(runway.latitude_deg))
    course = math.radians(runway.course_true_deg)
    return north * math.cos(course) + east * math.sin(course)


def dials(
    profile: Profile, runway: Runway, distance_m: float, altitude_msl_m: float, ground_speed_mps: float
) -> Dials:
    """The settings at a distance before the threshold, an altitude and a ground speed."""
    altitude_m, vertical_fpm, glide_slope = profile.start_altitude_msl_m, None, True
    if profile.kind == "step_down" and profile.lower_altitude_msl_m is not None:
        # Above the lower level the glide path must not be captured: it would be met before the step.
        if distance_m > (profile.step_from_threshold_m or 0.0):
            glide_slope = False
        else:
            altitude_m = profile.lower_altitude_msl_m
            glide_slope = altitude_msl_m - altitude_m < LEVEL_WITHIN_M
            vertical_fpm = None if glide_slope else STEP_DESCENT_FPM
    elif profile.kind == "continuous_descent":
        # Straight at the touchdown target; the autopilot takes over where the glide path is met.
        to_go_m = max(1_000.0, distance_m + runway.touchdown_past_threshold_m)
        slope = (altitude_msl_m - runway.altitude_msl_m) / to_go_m
        altitude_m = runway.altitude_msl_m
        vertical_fpm = round(-slope * ground_speed_mps * FPM_PER_MPS / 50.0) * 50.0
    return Dials(
        speed_kt=_at(SPEED_KT, distance_m),
        flap_ratio=_at(FLAP_RATIO, distance_m),
        gear_down=distance_m <= GEAR_DOWN_FROM_M,
        altitude_ft=altitude_m * FEET_PER_METER,
        vertical_speed_fpm=vertical_fpm,
        glide_slope=glide_slope,
    )


def _at(table: tuple[tuple[float, float], ...], distance_m: float) -> float:
    """The last entry whose distance has been reached."""
    return [value for from_m, value in table if distance_m <= from_m][-1]
