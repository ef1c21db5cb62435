"""WGS-84 poses <-> X-Plane's local OpenGL coordinates.

Local coordinates are metres from an origin that X-Plane moves when it loads scenery: x east, y up, z south **at that origin**.
Away from it, "up" is not y and "north" is not -z: 50 km away the two differ by half a degree. X-Plane's psi, theta, phi and the
angles of a camera are about the local axes, ours about north, east and down where the body is. So positions go through X-Plane's own
two conversions, and angles through the directions of north, east and down there, found with the same conversions.

Nothing is cached between calls: the origin may move at any time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Callable

from .messages import Pose

Vector = tuple[float, float, float]
# Rows of a 3x3 matrix.
Matrix = tuple[Vector, Vector, Vector]
# (latitude, longitude, altitude) -> (x, y, z), and back: xp.worldToLocal, xp.localToWorld.
Conversion = Callable[[float, float, float], Vector]

# How far to look along meridian and parallel for their directions. The chord's error is a sixth of this angle squared: 2e-10.
STEP_DEG = 0.002
STEP_M = 100.0


@dataclass(frozen=True)
class LocalPose:
    """Metres and degrees in X-Plane's local coordinates."""

    x: float
    y: float
    z: float
    psi: float
    theta: float
    phi: float

    def quaternion(self) -> tuple[float, float, float, float]:
        """The same attitude as X-Plane's ``q``: scalar first, from local axes to the aircraft's."""
        (cos_psi, sin_psi), (cos_theta, sin_theta), (cos_phi, sin_phi) = (
            (math.cos(math.radians(a) / 2), math.sin(math.radians(a) / 2)) for a in (self.psi, self.theta, self.phi)
        )
        return (
            cos_psi * cos_theta * cos_phi + sin_psi * sin_theta * sin_phi,
            cos_psi * cos_theta * sin_phi - sin_psi * sin_theta * cos_phi,
            cos_psi * sin_theta * cos_phi + sin_psi * cos_theta * sin_phi,
            sin_psi * cos_theta * cos_phi - cos_psi * sin_theta * sin_phi,
        )


class LocalFrame:
    """X-Plane's two conversions, and functions based on them."""

    def __init__(self, world_to_local: Conversion, local_to_world: Conversion) -> None:
        self._to_local = world_to_local
        self._to_world = local_to_world

    def place(self, pose: Pose) -> LocalPose:
        """A pose in local coordinates, with the current origin."""
        at = (pose.latitude_deg, pose.longitude_deg, pose.altitude_msl_m)
        turned = _product(self._axes(*at), _rotation(pose.heading_true_deg, pose.pitch_deg, pose.roll_deg))
        return LocalPose(*self._to_local(*at), *_angles(turned))

    def read(self, local: LocalPose) -> Pose:
        """A pose in local coordinates converted to the earth, with the current origin."""
        at = self._to_world(local.x, local.y, local.z)
        turned = _product(_transposed(self._axes(*at)), _rotation(local.psi, local.theta, local.phi))
        return Pose(*at, *_angles(turned))

    def velocity_ned(self, local: LocalPose, velocity: Vector) -> Vector:
        """A velocity along x, y, z as north, east, down."""
        axes = self._axes(*self._to_world(local.x, local.y, local.z))
        return _times(_transposed(axes), _north_east_down(velocity))

    def velocity_local(self, pose: Pose, ned: Vector) -> Vector:
        """A velocity north, east, down as x, y, z."""
        axes = self._axes(pose.latitude_deg, pose.longitude_deg, pose.altitude_msl_m)
        north, east, down = _times(axes, ned)
        return (east, -down, -north)

    def _axes(self, latitude: float, longitude: float, altitude: float) -> Matrix:
        """Columns: north, east and down at a place, along the local frame's -z, x and -y."""
        along = (
            ((latitude - STEP_DEG, longitude, altitude), (latitude + STEP_DEG, longitude, altitude)),
            ((latitude, longitude - STEP_DEG, altitude), (latitude, longitude + STEP_DEG, altitude)),
            ((latitude, longitude, altitude + STEP_M), (latitude, longitude, altitude - STEP_M)),
        )
        columns = []
        for begin, end in along:
            a, b = self._to_local(*begin), self._to_local(*end)
            columns.append(_unit(_north_east_down((b[0] - a[0], b[1] - a[1], b[2] - a[2]))))
        return _transposed((columns[0], columns[1], columns[2]))


def wrapped_360(degrees: float) -> float:
    """The same direction in [0, 360)."""
    return degrees % 360.0


def _north_east_down(xyz: Vector) -> Vector:
    return (-xyz[2], xyz[0], -xyz[1])


def _rotation(heading: float, pitch: float, roll: float) -> Matrix:
    """From body axes (forward, right, down) to north, east, down: roll, then pitch, then heading."""
    (ch, sh), (cp, sp), (cr, sr) = (
        (math.cos(math.radians(a)), math.sin(math.radians(a))) for a in (heading, pitch, roll)
    )
    return (
        (ch * cp, ch * sp * sr - sh * cr, ch * sp * cr + sh * sr),
        (sh * cp, sh * sp * sr + ch * cr, sh * sp * cr - ch * sr),
        (-sp, cp * sr, cp * cr),
    )


def _angles(m: Matrix) -> Vector:
    """Heading in [0, 360), pitch and roll of a rotation."""
    return (
        wrapped_360(math.degrees(math.atan2(m[1][0], m[0][0]))),
        math.degrees(math.asin(max(-1.0, min(1.0, -m[2][0])))),
        math.degrees(math.atan2(m[2][1], m[2][2])),
    )


def _times(m: Matrix, v: Vector) -> Vector:
    return tuple(sum(a * b for a, b in zip(row, v)) for row in m)  # type: ignore[return-value]


def _product(a: Matrix, b: Matrix) -> Matrix:
    columns = _transposed(b)
    return _transposed((_times(a, columns[0]), _times(a, columns[1]), _times(a, columns[2])))


def _transposed(m: Matrix) -> Matrix:
    return tuple(zip(*m))  # type: ignore[return-value]


def _unit(v: Vector) -> Vector:
    length = math.sqrt(sum(c * c for c in v))
    return (v[0] / length, v[1] / length, v[2] / length)
