"""Cameras: where a point of the world appears in their image."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

WGS84_SEMI_MAJOR_M = 6_378_137.0
WGS84_FLATTENING = 1 / 298.257223563
_ECCENTRICITY_SQUARED = WGS84_FLATTENING * (2 - WGS84_FLATTENING)
EARTH_RADIUS_M = 6_371_008.8
"""Mean radius of the earth (IUGG), by which `refraction_coefficient` is defined."""
FIELD_OVER_HALF_DIAGONAL = 1.5
"""Up to this multiple of the image's half diagonal a lens follows its polynomials; beyond, it continues linearly."""


def ecef_m(latitude_deg: npt.ArrayLike, longitude_deg: npt.ArrayLike, altitude_m: npt.ArrayLike) -> Floats:
    """ECEF coordinates on WGS-84, metres: an array of shape (..., 3). Heights are above the ellipsoid, as in the tables of a corpus."""
    latitude, longitude = np.radians(np.asarray(latitude_deg, float)), np.radians(np.asarray(longitude_deg, float))
    height = np.asarray(altitude_m, float)
    normal = WGS84_SEMI_MAJOR_M / np.sqrt(1 - _ECCENTRICITY_SQUARED * np.sin(latitude) ** 2)
    return np.stack(
        np.broadcast_arrays(
            (normal + height) * np.cos(latitude) * np.cos(longitude),
            (normal + height) * np.cos(latitude) * np.sin(longitude),
            (normal * (1 - _ECCENTRICITY_SQUARED) + height) * np.sin(latitude),
        ),
        axis=-1,
    )


def _up(ecef: Floats) -> Floats:
    """Away from the earth at a point: the normal of the ellipsoid, by Bowring's formula."""
    semi_minor_m = WGS84_SEMI_MAJOR_M * (1 - WGS84_FLATTENING)
    second = _ECCENTRICITY_SQUARED / (1 - _ECCENTRICITY_SQUARED)
    from_axis = np.hypot(ecef[0], ecef[1])
    parametric = np.arctan2(ecef[2] * WGS84_SEMI_MAJOR_M, from_axis * semi_minor_m)
    latitude = np.arctan2(
        ecef[2] + second * semi_minor_m * np.sin(parametric) ** 3,
        from_axis - _ECCENTRICITY_SQUARED * WGS84_SEMI_MAJOR_M * np.cos(parametric) ** 3,
    )
    longitude = np.arctan2(ecef[1], ecef[0])
    return np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)])


@dataclass(frozen=True)
class Camera:
    """Intrinsics and extrinsics of a camera, as in `calibration.json`.

    Camera axes are OpenCV's: x right, y down, z forward. Pixel (0, 0) is the centre of the top-left pixel.
    """

    width_px: int
    height_px: int
    k: Floats
    """3x3 matrix of intrinsics."""
    distortion: Floats
    """OpenCV's k1, k2, p1, p2, k3; all 0 for a pinhole."""
    ecef_from_camera: Floats
    """3x3 rotation from camera axes to ECEF."""
    center_ecef_m: Floats
    """The projection centre."""
    refraction_coefficient: float = 0.0

    @classmethod
    def of_calibration(cls, entry: dict[str, Any]) -> "Camera":
        """The camera of an entry of `cameras` in `calibration.json`."""
        placement = entry["ecef_from_camera"]
        return cls(
            width_px=entry["width_px"],
            height_px=entry["height_px"],
            k=np.array(entry["k"], float),
            distortion=np.array(entry["distortion"] or [0.0] * 5, float),
            ecef_from_camera=np.array(placement["rotation"], float),
            center_ecef_m=np.array(placement["translation_m"], float),
            refraction_coefficient=entry.get("refraction_coefficient", 0.0),
        )

    def to_camera(self, points_ecef_m: npt.ArrayLike) -> Floats:
        """Where ECEF points (..., 3) appear, in camera axes, metres."""
        seen = np.asarray(points_ecef_m, float) - self.center_ecef_m
        if self.refraction_coefficient:
            up = _up(self.center_ecef_m)
            level = seen - (seen @ up)[..., None] * up
            lift = self.refraction_coefficient * np.sum(level**2, axis=-1) / (2 * EARTH_RADIUS_M)
            seen = seen + lift[..., None] * up
        return np.asarray(seen @ self.ecef_from_camera)

    def project(self, points_ecef_m: npt.ArrayLike) -> Floats:
        """Pixels (..., 2), right and down, of ECEF points (..., 3); NaN behind the camera. They may be outside the image."""
        point = self.to_camera(points_ecef_m)
        depth = np.where(point[..., 2:] > 0, point[..., 2:], np.nan)
        image = self._distorted(point[..., :2] / depth)
        return np.asarray(image * self.k[[0, 1], [0, 1]] + self.k[[0, 1], [2, 2]])

    def _distorted(self, ideal: Floats) -> Floats:
        if not self.distortion.any():
            return ideal
        k1, k2, p1, p2, k3 = self.distortion
        field = FIELD_OVER_HALF_DIAGONAL * np.hypot(self.width_px, self.height_px) / 2 / self.k[0, 0]
        length = np.linalg.norm(ideal, axis=-1, keepdims=True)
        rim = ideal * np.minimum(1.0, field / np.maximum(length, 1e-300))
        x, y = rim[..., 0], rim[..., 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        tangential = np.stack(
            [2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y],
            axis=-1,
        )
        return np.asarray(rim * radial[..., None] + tangential + (ideal - rim))
