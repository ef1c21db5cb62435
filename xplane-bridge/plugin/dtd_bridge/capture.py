"""One picture: settle frames, the frame that counts, and what it really showed.

Written as generators: each ``yield`` waits for the next flight loop, that is, for one more drawn frame.
"""

from __future__ import annotations

import math
import time
from typing import Any, Generator

from . import datarefs as names
from .datarefs import Datarefs
from .messages import Capture, Pose, Refusal
from .pixels import Pixels
from .stage import Stage, Tick

# Less than the client's minute, so that it hears why.
TIME_LIMIT_S = 50.0
# How far what X-Plane has may be from what was asked before a frame is thought to be disturbed and taken again. The client judges for itself.
POSITION_M = 0.01
ANGLE_DEG = 0.0002
# A picture is taken so often before what X-Plane has is reported as it is.
TRIES = 5
METERS_PER_DEGREE = 111_320.0

Answer = tuple[dict[str, Any], bytes]


def take(
    request: Capture, stage: Stage, pixels: Pixels, datarefs: Datarefs, settle_frames: int, xp: Any
) -> Generator[None, None, Answer]:
    """Shows a tick and returns its ``frame``."""
    _check_window(request, datarefs)
    if request.wants_picture and pixels.no_readback:
        raise Refusal(f"{pixels.no_readback}; take the pictures off the screen instead (--pixels screen)")
    deadline = time.monotonic() + TIME_LIMIT_S
    tick = Tick(request.pose, request.flap_ratio, request.gear_ratio, request.camera, request.hfov_deg)
    for tried in range(1, TRIES + 1):
        stage.show(tick)
        yield from _settle(stage, settle_frames, deadline, xp)
        pixels.want_frame(request.wants_picture)
        cycle = xp.getCycleNumber()
        yield
        picture = pixels.take_frame(cycle)
        pixels.want_frame(False)
        _raise_if_failed(stage, pixels)
        pose, (camera, hfov_deg) = stage.read_pose(), stage.read_camera()
        whole = stage.written_in(cycle) and (picture is not None or not request.wants_picture)
        same = _near(pose, request.pose) and _near(camera, request.camera) and abs(hfov_deg - request.hfov_deg) < ANGLE_DEG
        if whole and (same or tried == TRIES):
            return _answer(request, cycle, pose, camera, hfov_deg, picture)
    raise Refusal(f"X-Plane drew no undisturbed frame in {TRIES} tries: is something else moving the camera?")


def _settle(stage: Stage, frames: int, deadline: float, xp: Any) -> Generator[None, None, None]:
    """Lets so many frames in a row be drawn with pose and camera of the tick while no scenery loads."""
    settled = 0
    while settled < frames:
        stage.keep_camera()
        cycle, loading = xp.getCycleNumber(), stage.scenery_is_loading()
        yield
        if stage.error:
            raise Refusal(stage.error)
        undisturbed = stage.written_in(cycle) and not loading and not stage.scenery_is_loading()
        settled = settled + 1 if undisturbed else 0
        if time.monotonic() > deadline:
            why = "scenery was loading" if stage.scenery_is_loading() else "the camera was not to be had"
            raise Refusal(f"no {frames} frames in a row within {TIME_LIMIT_S:.0f} s: {why}")
    stage.keep_camera()


def _answer(
    request: Capture, cycle: int, pose: Pose, camera: Pose, hfov_deg: float, picture: tuple[int, int, bytes] | None
) -> Answer:
    payload = b""
    if picture is not None:
        width, height, payload = picture
        if (width, height) != (request.width_px, request.height_px):
            raise Refusal(
                f"X-Plane draws {width}x{height} pixels, {request.width_px}x{request.height_px} are wanted: "
                "set the size of its window, or the scale of the display to 100 %"
            )
    header = {
        "message": "frame",
        "tick": request.tick,
        "view": request.view,
        "sim_frame": cycle,
        "pose": pose.header(),
        "camera": {**camera.header(), "hfov_deg": hfov_deg},
        "width_px": request.width_px,
        "height_px": request.height_px,
    }
    return header, payload


def _check_window(request: Capture, datarefs: Datarefs) -> None:
    """The field of view is horizontal: a window of another shape would show more or less above and below."""
    width, height = (datarefs.get(name) for name in names.WINDOW_SIZE)
    if width <= 0 or height <= 0:
        raise Refusal(f"X-Plane's window has {width:.0f}x{height:.0f} pixels: is it minimised?")
    if abs(width * request.height_px / request.width_px - height) > 1.0:
        raise Refusal(
            f"X-Plane's window is {width:.0f}x{height:.0f}, which has not the shape of a picture of "
            f"{request.width_px}x{request.height_px}: set its size (Settings > Graphics)"
        )


def _raise_if_failed(stage: Stage, pixels: Pixels) -> None:
    error, pixels.error = stage.error or pixels.error, None
    if error:
        raise Refusal(error)


def _near(a: Pose, b: Pose) -> bool:
    """Whether two poses are the same but for rounding."""
    north = (a.latitude_deg - b.latitude_deg) * METERS_PER_DEGREE
    east = (a.longitude_deg - b.longitude_deg) * METERS_PER_DEGREE * math.cos(math.radians(a.latitude_deg))
    away = math.hypot(north, east, a.altitude_msl_m - b.altitude_msl_m)
    turned = max(
        abs((x - y + 180) % 360 - 180)
        for x, y in (
            (a.heading_true_deg, b.heading_true_deg),
            (a.pitch_deg, b.pitch_deg),
            (a.roll_deg, b.roll_deg),
        )
    )
    return away <= POSITION_M and turned <= ANGLE_DEG
