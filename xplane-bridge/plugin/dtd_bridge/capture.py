"""One image: settle frames, the frame that counts, and what it actually showed.

Written as generators: each ``yield`` waits for the next flight loop, that is, for one more drawn frame.
"""

from __future__ import annotations

import math
import time
from typing import Any, Generator

from . import datarefs as names
from .datarefs import Datarefs
from .log import log
from .messages import Capture, Pose, Refusal
from .pixels import Frame, Pixels
from .stage import Stage, Tick
from .xp_api import Xp

# Less than the client's minute, so that the client learns the reason.
TIME_LIMIT_S = 50.0
# How far X-Plane's values may deviate from the request before a frame counts as disturbed and is repeated. The client makes the
# final decision.
POSITION_M = 0.01
ANGLE_DEG = 0.0002
# Attempts at a picture before X-Plane's values are reported as they are.
TRIES = 5
# A new pose shows within a few frames. A picture that still equals the previous one after this many shows no change: an aircraft in
# fog.
STALE_FRAMES = 10
# Pictures that move by themselves, as in rain, prove nothing by their content: they are right once as many frames have settled as any
# X-Plane has needed. A camera that was taken and is back shows as late as a new pose.
UNPROVEN_SETTLE_FRAMES = 5
# In a pause two consecutive pictures are equal once exposure and shadows have settled. If they never are (moving water), the
# comparison is useless.
RESTLESS_FRAMES = 30
# Draw callbacks come 0 to n times a frame.
UNDRAWN_FRAMES = 10
METERS_PER_DEGREE = 111_320.0

Answer = tuple[dict[str, Any], bytes]
Wait = Generator[None, None, None]


def take(
    request: Capture, stage: Stage, pixels: Pixels, datarefs: Datarefs, settle_frames: int, xp: Xp
) -> Generator[None, None, Answer]:
    """Shows a tick and returns its ``frame``."""
    check_window(request, datarefs)
    if request.deliver == "picture" and pixels.no_readback:
        raise Refusal(f"{pixels.no_readback}; take the images off the screen instead (--pixels screen)")
    deadline = time.monotonic() + TIME_LIMIT_S
    tick = tick_of(request)
    shown_at, tried = stage.frames, 0
    while True:
        stage.show(tick)
        is_restless = pixels.restless or stage.time_runs
        yield from _settle(stage, max(settle_frames, UNPROVEN_SETTLE_FRAMES) if is_restless else settle_frames, deadline)
        picture = None
        if request.deliver == "drawn":
            yield
        else:
            picture = yield from _new_picture(tick, shown_at, stage, pixels, xp)
        _raise_if_failed(stage, pixels)
        while stage.origin_moved():
            yield
        pose, (camera, hfov_deg, vfov_deg) = stage.read_pose(), stage.read_camera()
        if not stage.is_shown() or (request.deliver != "drawn" and picture is None):
            # Disturbed; the settling time limits how often.
            continue
        tried += 1
        if is_as_wanted(request, pose, camera, hfov_deg, vfov_deg) or tried == TRIES:
            _check_shape(request, vfov_deg, tick.vfov_deg)
            stage.mark_as_shown()
            return answer(request, stage.frames, pose, camera, hfov_deg, picture)


def tick_of(request: Capture) -> Tick:
    """What a request shows. X-Plane's angles are those of its window: margins around the image widen them, by the tangents."""
    per_pixel = 2 * math.tan(math.radians(request.hfov_deg) / 2) / request.width_px
    hfov_deg, vfov_deg = (
        2 * math.degrees(math.atan(per_pixel * (side + 2 * margin) / 2))
        for side, margin in ((request.width_px, request.margin_x_px), (request.height_px, request.margin_y_px))
    )
    if not request.margin_x_px:
        # Exactly as it was asked for.
        hfov_deg = request.hfov_deg
    return Tick(request.pose, request.flap_ratio, request.gear_ratio, request.camera, hfov_deg, vfov_deg)


def is_as_wanted(request: Capture, pose: Pose, camera: Pose, hfov_deg: float, vfov_deg: float) -> bool:
    """Whether what X-Plane gives back is the request, but for rounding."""
    tick = tick_of(request)
    return (
        _near(pose, request.pose)
        and _near(camera, request.camera)
        and abs(hfov_deg - tick.hfov_deg) < ANGLE_DEG
        and abs(vfov_deg - tick.vfov_deg) < ANGLE_DEG
    )


def _of_picture(request: Capture, window_hfov_deg: float) -> float:
    """The horizontal field of view of the image within the window's."""
    if not request.margin_x_px:
        return window_hfov_deg
    share = request.width_px / (request.width_px + 2 * request.margin_x_px)
    return 2 * math.degrees(math.atan(math.tan(math.radians(window_hfov_deg) / 2) * share))


def _settle(stage: Stage, frames: int, deadline: float) -> Wait:
    """Waits until this many frames in a row are drawn with pose and camera of the tick while no scenery loads."""
    stage.keep_camera()
    first = stage.written
    while stage.written - first < frames:
        yield
        if stage.error:
            raise Refusal(stage.error)
        if not stage.is_shown() or stage.scenery_is_loading():
            stage.keep_camera()
            first = stage.written
        if time.monotonic() > deadline:
            raise Refusal(f"no {frames} frames in a row within {TIME_LIMIT_S:.0f} s: {stage.what_is_wrong_with_the_view()}")


def _read_back(stage: Stage, pixels: Pixels) -> Generator[None, None, Frame | None]:
    """The next frame, or nothing if it was disturbed."""
    for _ in range(UNDRAWN_FRAMES):
        pixels.want_frame()
        yield
        picture = pixels.take_frame()
        if stage.error or pixels.error or not stage.is_shown():
            return None
        if picture is not None:
            return picture
    return None


def _new_picture(
    tick: Tick, shown_at: int, stage: Stage, pixels: Pixels, xp: Xp
) -> Generator[None, None, Frame | None]:
    """The settled image of a tick, proven by its content: it differs from the previous tick's, and it does not change any more.
    ``None`` if it was disturbed."""
    before: Frame | None = None
    for _ in range(RESTLESS_FRAMES):
        picture = yield from _read_back(stage, pixels)
        if picture is None:
            return None
        is_new = stage.frames - shown_at > STALE_FRAMES or pixels.is_new(tick, picture)
        stands_still = pixels.restless or stage.time_runs or picture == before
        if is_new and stands_still:
            break
        before = picture
    else:
        if not pixels.restless:
            log(xp, "no two images in a row agree in a pause: something moves, and is not waited for any more")
        pixels.restless = True
        picture = before
    if picture is not None:
        pixels.remember(tick, picture)
    return picture


def answer(
    request: Capture, frame: int, pose: Pose, camera: Pose, hfov_deg: float, picture: Frame | None
) -> Answer:
    """The answer to a request: what was drawn in a frame, with the window's field of view."""
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
        "sim_frame": frame,
        "pose": pose.header(),
        "camera": {**camera.header(), "hfov_deg": _of_picture(request, hfov_deg)},
        "width_px": request.width_px,
        "height_px": request.height_px,
    }
    return header, payload


def check_window(request: Capture, datarefs: Datarefs) -> None:
    """The field of view is horizontal: a window of another shape would show more or less above and below."""
    width, height = (datarefs.get(name) for name in names.WINDOW_SIZE)
    if width <= 0 or height <= 0:
        raise Refusal(f"X-Plane's window has {width:.0f}x{height:.0f} pixels: is it minimised?")
    wanted_width, wanted_height = request.width_px + 2 * request.margin_x_px, request.height_px + 2 * request.margin_y_px
    if abs(width * wanted_height / wanted_width - height) > 1.0:
        margins = f" with margins of {request.margin_x_px} and {request.margin_y_px}" if request.margin_x_px or request.margin_y_px else ""
        raise Refusal(
            f"X-Plane's window is {width:.0f}x{height:.0f}, which has not the shape of an image of "
            f"{request.width_px}x{request.height_px}{margins}: set its size (Settings > Graphics)"
        )


def _check_shape(request: Capture, vfov_deg: float, wanted_deg: float) -> None:
    """The answer has no vertical angle, so a wrong one would go unnoticed."""
    if abs(vfov_deg - wanted_deg) >= ANGLE_DEG:
        raise Refusal(
            f"X-Plane's vertical field of view is {vfov_deg:.4f} degrees, expected {wanted_deg:.4f} for an image of "
            f"{request.width_px}x{request.height_px}: does another plugin set it ({names.VERTICAL_FIELD_OF_VIEW})?"
        )


def _raise_if_failed(stage: Stage, pixels: Pixels) -> None:
    error, pixels.error = stage.error or pixels.error, None
    if error:
        raise Refusal(error)


def _near(a: Pose, b: Pose) -> bool:
    """Whether two poses are equal except for rounding."""
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
