"""Predicts where wheels, wing tips and nose of rendered aircraft are in the image, with its own WGS-84 and camera code.

Nothing of the project's geometry is used. Known are the aircraft's published dimensions (span 35.8 m; the nose 18.2 m ahead of the
centre of gravity, which the main wheels follow by 1.4 m and the nose wheels precede by 14.2 m; wheels 3.2 m below it), the
requested poses, and the camera's position, direction and field of view. Measured is the box of pixels that an aircraft changes.

The wing tips carry lamps whose glow reaches beyond them; against the noon sky the wings are dark, so their columns are those that
got darker. A pixel changes when the outline crosses any part of it, so one edge is up to half a pixel off the true one; over poses
at sixteen fractions of a pixel that averages out.

Some images are drawn with a lens and refraction. The lens is OpenCV's model, implemented here from OpenCV's documentation; a
refracted ray is an arc of a circle of the earth's radius over the coefficient, whose tangent at the camera is the apparent
direction.

usage: render_geometry.py FOLDER     of scenes.json and the raw images that it names; prints JSON; exit 1 beyond 0.3 px
"""

import json
import pathlib
import sys

import numpy as np

A, F = 6378137.0, 1 / 298.257223563
EARTH_RADIUS = 6371000.0
E2 = F * (2 - F)
LIMIT_PX = 0.3

NOSE = [(18.2, 0.0, 0.0)]
WHEELS = [(-1.4, side * y, 3.2) for side in (-1, 1) for y in (2.4, 2.86, 3.3)] + [(14.2, 0.0, 3.2)]
WING_TIPS = [(0.0, side * 17.9, -1.0) for side in (-1, 1)]


def ned_axes(latitude_deg, longitude_deg):
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    north = np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    return np.stack([north, east, np.cross(north, east)], axis=1)


def ecef(pose):
    lat, lon = np.radians(pose["latitude_deg"]), np.radians(pose["longitude_deg"])
    n, h = A / np.sqrt(1 - E2 * np.sin(lat) ** 2), pose["altitude_msl_m"]
    return np.array([(n + h) * np.cos(lat) * np.cos(lon), (n + h) * np.cos(lat) * np.sin(lon), (n * (1 - E2) + h) * np.sin(lat)])


def forward_right_down(pose):
    """The body's axes in ECEF: heading about down, then pitch about right, then roll about forward."""
    h, p, r = np.radians([pose["heading_true_deg"], pose["pitch_deg"], pose["roll_deg"]])
    yaw = np.array([[np.cos(h), -np.sin(h), 0], [np.sin(h), np.cos(h), 0], [0, 0, 1]])
    pitch = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    roll = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
    return ned_axes(pose["latitude_deg"], pose["longitude_deg"]) @ yaw @ pitch @ roll


def bent(seen, up, coefficient):
    """The chords of rays of light, rotated upwards to the arcs' tangents."""
    length = np.linalg.norm(seen, axis=1, keepdims=True)
    along = seen / length
    upwards = up - along * (along @ up)[:, None]
    upwards /= np.linalg.norm(upwards, axis=1, keepdims=True)
    angle = np.arcsin(length * coefficient / (2 * EARTH_RADIUS))
    return length * (along * np.cos(angle) + upwards * np.sin(angle))


def distorted(x, y, coefficients):
    k1, k2, p1, p2, k3 = coefficients
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    return x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y


def project(camera, width, height, points):
    """Pixels of ECEF points; the centre of the upper left pixel is (0, 0)."""
    forward, right, down = forward_right_down(camera).T
    focal = width / 2 / np.tan(np.radians(camera["hfov_deg"]) / 2)
    up = -ned_axes(camera["latitude_deg"], camera["longitude_deg"])[:, 2]
    seen = bent(np.asarray(points) - ecef(camera), up, camera["refraction_coefficient"])
    depth = seen @ forward
    x, y = distorted((seen @ right) / depth, (seen @ down) / depth, camera["distortion"])
    return np.stack([(width - 1) / 2 + focal * x, (height - 1) / 2 + focal * y], axis=1)


def main(folder: pathlib.Path) -> int:
    scenes = json.loads((folder / "scenes.json").read_text())
    offsets = {}
    for scene in scenes["frames"]:
        width, height = scenes["width_px"], scenes["height_px"]
        read = lambda name: np.frombuffer((folder / name).read_bytes(), np.uint8).reshape(height, width, 3)
        picture, empty = read(scene["picture"]).astype(int), read(scene["empty"]).astype(int)
        rows, columns = (np.flatnonzero((picture != empty).any(axis=(axis, 2))) for axis in (1, 0))
        darker = np.flatnonzero(((picture - empty).sum(axis=2) < 0).any(axis=0))
        axes, centre = forward_right_down(scene["pose"]), ecef(scene["pose"])
        pixels = lambda marks: project(scene["camera"], width, height, centre + np.array(marks) @ axes.T)
        note = lambda mark, offset: offsets.setdefault(f"{mark} at {scene['distance_nm']} NM{scene['through']}", []).append(offset)
        if scene["seen_from"] == "ahead":
            tips = pixels(WING_TIPS)[:, 0]
            note("left edge, wing tip", darker[0] - tips.min())
            note("right edge, wing tip", darker[-1] - tips.max())
            note("lower edge, wheels", rows[-1] - pixels(WHEELS)[:, 1].max())
        else:
            nose = pixels(NOSE)[0, 0]
            note(f"nose, {scene['seen_from']}", (columns[0] if scene["seen_from"] == "flying left" else columns[-1]) - nose)
    means = {mark: round(float(np.mean(values)), 3) for mark, values in offsets.items()}
    worst = max(abs(mean) for mean in means.values())
    print(json.dumps({"frames": len(scenes["frames"]), "worst_px": worst, "offsets_px": means}))
    return 0 if worst < LIMIT_PX else 1


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1])))
