"""Freezing and posing: the flight model stopped, time stopped, pose and camera of a tick written together.

X-Plane asks for the camera once a frame, before it draws. In that one callback both pose and camera of the tick are converted with the
current local origin and written, so no frame shows the pose of one tick from the camera of another; the flight loop after the flight
model writes the pose, too, for what X-Plane computes in between, and nothing depends on which of the two comes first. Requests are served
before the flight model, between two frames. What counts is that the callback came at all: it does not when somebody took the camera (a
view key). Such frames do not count, and the camera is taken back, in an external view: in any other the cockpit is
drawn around it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Callable

from . import datarefs as names
from .datarefs import Datarefs
from .found import command, set_pause
from .local_frame import LocalFrame, LocalPose, wrapped_360
from .log import Faults
from .messages import Clock, Pose, Refusal
from .xp_api import Xp

# X-Plane has 10 landing gears.
GEARS = 10
# An external view shows within a frame or two; the command is repeated after this many.
VIEW_FRAMES = 30
# A camera callback that failed this often in a row will not succeed.
FAULTS_LIMIT = 10
# X-Plane moves its local origin by kilometres.
ORIGIN_MOVED_M = 0.01
FREE_CAMERA = "sim/view/free_camera"
# Windows over the scene, as far as X-Plane has commands for them.
CLOSING = (
    "sim/operation/close_windows", "sim/instruments/map_close", "sim/GPS/g1000n1_popup_close",
    *(f"sim/instruments/popup_{number}_close" for number in range(1, 13)),
)  # fmt: skip


@dataclass(frozen=True)
class Tick:
    """Content of one image."""

    pose: Pose
    flap_ratio: float
    gear_ratio: float
    camera: Pose
    hfov_deg: float
    vfov_deg: float


class Stage:
    """The frozen aircraft and the camera. All of it in X-Plane's main thread."""

    def __init__(self, xp: Xp, datarefs: Datarefs, frame: LocalFrame, faults: Faults) -> None:
        self._xp = xp
        self._faults = faults
        self._datarefs = datarefs
        self._frame = frame
        self._tick: Tick | None = None
        self._running_at: Clock | None = None
        # Our own counts: X-Plane's cycle number advances at another pace.
        self._frames = 0
        self._written = 0
        self._holds_camera = False
        # How often the camera was taken: whoever loses it is told, also an earlier one of our own callbacks, to which this number is
        # its reference.
        self._camera_number = 0
        # Where the camera was placed last.
        self._camera: LocalPose | None = None
        # Camera callbacks that failed, one after the other.
        self._failed_in_a_row = 0
        self._asked_for_view_at: int | None = None
        self._frozen = False
        # Where the aircraft was when it was frozen.
        self._before: Pose | None = None
        # Whether every frame since the tick was reported as drawn has shown it.
        self._still_shown = False
        # Asked in each camera callback what to show from this frame on, if anything is shown frame by frame.
        self.next_tick: Callable[[], Tick | None] | None = None
        self.error: str | None = None

    @property
    def frames(self) -> int:
        """Frames since the plugin was enabled."""
        return self._frames

    @property
    def frozen(self) -> bool:
        """Whether we have stopped the flight model and time."""
        return self._frozen

    @property
    def time_runs(self) -> bool:
        """Whether time keeps running although the aircraft is frozen."""
        return self._running_at is not None

    def freeze(self, running_at: Clock | None) -> None:
        """Stops the flight model, and time: paused, X-Plane still draws and still accepts poses, but nothing moves by itself. With
        a clock, time keeps running instead, and the clock is set back to it in every frame: rain and snow fall only while time
        runs."""
        if not self._frozen:
            self._before = self.read_pose()
        self._frozen = True
        self._running_at = running_at
        self._hold()
        set_pause(self._xp, self._datarefs, running_at is None)
        self._clear_the_view()

    def is_still(self) -> bool:
        """Whether time is stopped or running as the freeze requested."""
        return self.paused() != self.time_runs

    def put_back(self) -> None:
        """Returns the aircraft to its place: shown in the air, a parked one would fall and crash."""
        if self._frozen and self._before is not None:
            self.write_pose(self._before)

    def release(self) -> None:
        """Releases control. What was changed is restored by the module that saved it."""
        self._tick = self._running_at = self._asked_for_view_at = None
        self._still_shown = False
        if self._holds_camera:
            self._holds_camera = False
            self._xp.dontControlCamera()
        if self._frozen:
            self._frozen = False
            self.let_go()

    def hold(self) -> None:
        """Stops only the flight model."""
        self._datarefs.set(names.OVERRIDE_FLIGHT_MODEL, 1)

    def let_go(self) -> None:
        """Returns the aircraft to the flight model, stick and levers."""
        self._datarefs.set_if_there(names.OVERRIDES, 0)

    def close_windows(self) -> None:
        """Closes the windows of X-Plane's user interface that can be closed by a command or a dataref."""
        for path in CLOSING:
            found = self._xp.findCommand(path)
            if found:
                self._xp.commandOnce(found)
        self._datarefs.fill(names.POP_UPS, 0)

    def _hold(self) -> None:
        self._datarefs.set_if_there(names.OVERRIDES, 1)

    def _clear_the_view(self) -> None:
        """Removes what covers the image: windows, instruments, the cross of a mouse that flies. Landing lights on."""
        self.close_windows()
        self._datarefs.set_if_there((names.MOUSE_IS_YOKE,), 0)
        self._datarefs.set_if_there(names.LANDING_LIGHTS, 1)

    def begin_frame(self) -> None:
        """Before the flight model: looks back at the frame that was drawn."""
        self._frames += 1
        if self._frozen and (not self.is_shown() or not self.is_still() or self.scenery_is_loading()):
            self._still_shown = False

    def patch(self) -> None:
        """After the flight model: undoes whatever X-Plane or another flight has changed since the last frame."""
        if not self._frozen:
            return
        self._hold()
        if self._tick is not None:
            self.write_pose(self._tick.pose)
        if self._running_at is not None:
            self._datarefs.set(names.USE_SYSTEM_TIME, 0)
            self._datarefs.set(names.DATE_DAYS, self._running_at.day_of_year - 1)
            self._datarefs.set(names.ZULU_TIME_S, self._running_at.zulu_time_s)

    def paused(self) -> bool:
        """Whether simulated time stands still."""
        return self._datarefs.get(names.PAUSED) != 0

    def scenery_is_loading(self) -> bool:
        """Whether X-Plane is loading scenery in the background; false if it does not report that."""
        return self._datarefs.get_or(names.SCENERY_LOADING, 0.0) != 0

    def command(self, path: str) -> None:
        """Runs one of X-Plane's commands once; a missing one is noted in the log."""
        command(self._xp, path)

    def show(self, tick: Tick) -> None:
        """From the next frame on, until told otherwise."""
        self._tick = tick
        self._still_shown = False
        self._failed_in_a_row = 0
        self.error = None

    def mark_as_shown(self) -> None:
        """The tick is on the screen, where a client may grab it until the next request."""
        self._still_shown = True

    @property
    def still_shown(self) -> bool:
        """Whether the view was ours in every frame since then. Whoever takes it loses nothing but a repeated image."""
        return self._still_shown

    def keep_view(self) -> None:
        """Between two requests: a client may still be grabbing the last one's frame off the screen."""
        if self._frozen and self._tick is not None and not self.is_shown():
            self.keep_camera()

    def keep_camera(self) -> None:
        """Takes the camera unless we have it; from an external view only, which is asked for first."""
        if not self._is_external():
            if self._holds_camera:
                self._holds_camera = False
                self._xp.dontControlCamera()
            asked_at = self._asked_for_view_at
            if asked_at is None or self._frames - asked_at >= VIEW_FRAMES:
                self._asked_for_view_at = self._frames
                self.command(FREE_CAMERA)
            return
        self._asked_for_view_at = None
        if not self._holds_camera:
            self._camera_number += 1
            self._xp.controlCamera(self._xp.ControlCameraForever, self.on_camera, self._camera_number)
            # Not before: taking the camera tells the callback that had it, which may be ours.
            self._holds_camera = True

    def _is_external(self) -> bool:
        return self._datarefs.get_or(names.VIEW_IS_EXTERNAL, 1.0) != 0

    @property
    def written(self) -> int:
        """How often pose and camera were written together, once a frame. The callback comes before our flight loop in some frames
        and after it in others, so there may be none or two of them between two loops."""
        return self._written

    def is_shown(self) -> bool:
        """Whether the view is ours, and from outside. Once lost it stays so until the camera is taken again."""
        return self._holds_camera and self._is_external()

    def what_is_wrong_with_the_view(self) -> str:
        """Why no frame counts, as text."""
        if self.scenery_is_loading():
            return "scenery was loading"
        if not self._is_external():
            return f"X-Plane shows the cockpit and {FREE_CAMERA} does not help: choose an outside view"
        return "the camera was not to be had: switch off other camera plugins"

    def on_camera(self, position: list[float] | None, is_losing_control: int, number: object) -> int:
        """X-Plane asks for the camera's position. The list must be changed in place; 1 means that it was, and 0 gives the camera
        up."""
        try:
            if number != self._camera_number:
                return 0
            if is_losing_control or self._tick is None or position is None:
                self._holds_camera = False
                return 0
            if self.next_tick is not None:
                self._tick = self.next_tick() or self._tick
            self._write(self._tick, position)
            self._written += 1
            self._failed_in_a_row = 0
            return 1
        except Exception as error:  # Nothing may escape into X-Plane. The frame does not count, and the camera is taken again.
            self._faults.caught("the camera's callback", error)
            self._holds_camera = self._still_shown = False
            self._failed_in_a_row += 1
            if self._failed_in_a_row >= FAULTS_LIMIT:
                self.error = f"cannot place aircraft and camera: {error!r}"
            return 0

    def _write(self, tick: Tick, position: list[float]) -> None:
        self.write_pose(tick.pose)
        self._write_controls(tick.flap_ratio, tick.gear_ratio)
        self._datarefs.set_if_there((names.NON_PROPORTIONAL_VIEW,), 1)
        self._datarefs.set(names.FIELD_OF_VIEW, tick.hfov_deg)
        self._datarefs.set_if_there((names.VERTICAL_FIELD_OF_VIEW,), tick.vfov_deg)
        self._camera = camera = self._frame.place(tick.camera)
        # Pitch comes before heading here, and the zoom is 1: the field of view is set.
        position[:] = [camera.x, camera.y, camera.z, camera.theta, camera.psi, camera.phi, 1.0]

    def write_pose(self, pose: Pose) -> None:
        """Places the aircraft, converted with the current local origin."""
        local = self._frame.place(pose)
        for name, value in zip(names.LOCAL_XYZ, (local.x, local.y, local.z)):
            self._datarefs.set(name, value)
        # The angles are drawn, the flight model continues from the quaternion: write both, or one overwrites the other.
        for name, value in zip(names.ATTITUDE, (local.psi, local.theta, local.phi)):
            self._datarefs.set(name, value)
        self._datarefs.set_array(names.QUATERNION, local.quaternion())
        self._datarefs.set_if_there(names.ROTATION_RATES, 0.0)

    def _write_controls(self, flap_ratio: float, gear_ratio: float) -> None:
        self._datarefs.set_if_there(names.FLAPS_WANTED, flap_ratio)
        self._datarefs.set_if_there(names.FLAPS_DRAWN, flap_ratio)
        self._datarefs.set_if_there(names.GEAR_WANTED, 1 if gear_ratio > 0.5 else 0)
        self._datarefs.set_array(names.GEAR_DRAWN, [gear_ratio] * GEARS)

    def origin_moved(self) -> bool:
        """Whether X-Plane has moved its local origin since the last frame was drawn: that frame's coordinates cannot be converted."""
        if self._tick is None or self._camera is None:
            return False
        now, then = self._frame.place(self._tick.camera), self._camera
        return math.dist((now.x, now.y, now.z), (then.x, then.y, then.z)) > ORIGIN_MOVED_M

    def read_local_pose(self) -> LocalPose:
        """The aircraft's position in X-Plane, local coordinates."""
        return LocalPose(*(self._datarefs.get(name) for name in names.LOCAL_XYZ + names.ATTITUDE))

    def read_pose(self) -> Pose:
        """The aircraft's position in X-Plane."""
        return self._frame.read(self.read_local_pose())

    def read_camera(self) -> tuple[Pose, float, float]:
        """X-Plane's camera, and its horizontal and vertical fields of view. An X-Plane without a writable vertical one derives it
        from the window, whose shape is checked."""
        x, y, z, heading, pitch, roll = (self._datarefs.get(name) for name in names.VIEW_POSE)
        camera = self._frame.read(LocalPose(x, y, z, wrapped_360(heading), pitch, roll))
        wanted = self._tick.vfov_deg if self._tick is not None else math.nan
        return camera, self._datarefs.get(names.FIELD_OF_VIEW), self._datarefs.get_or(names.VERTICAL_FIELD_OF_VIEW, wanted)

    def check_it_is_live(self) -> None:
        """In a replay X-Plane overwrites every pose."""
        if self._datarefs.get_or(names.IS_IN_REPLAY, 0.0) != 0:
            raise Refusal("X-Plane shows a replay: leave it (sim/replay/replay_off), then try again")
