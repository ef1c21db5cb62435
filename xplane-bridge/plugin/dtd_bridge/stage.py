"""Standing still, and being put somewhere: the flight model stopped, time stopped, pose and camera of a tick written together.

X-Plane asks for the camera once a frame, before it draws. In that one callback both pose and camera of the tick are converted with the
local origin of that moment and written, so no frame shows the pose of one tick from the camera of another. The callback
fails to come when somebody took the camera (a view key, a screenshot): such frames do not count, and the camera is taken back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from . import datarefs as names
from .datarefs import Datarefs
from .local_frame import LocalFrame, LocalPose, wrapped_360
from .messages import Pose

# X-Plane has 10 landing gears.
GEARS = 10


@dataclass(frozen=True)
class Tick:
    """What one picture shows."""

    pose: Pose
    flap_ratio: float
    gear_ratio: float
    camera: Pose
    hfov_deg: float


class Stage:
    """The frozen aircraft and the camera. All of it in X-Plane's main thread."""

    def __init__(self, xp: Any, datarefs: Datarefs, frame: LocalFrame) -> None:
        self._xp = xp
        self._datarefs = datarefs
        self._frame = frame
        self._tick: Tick | None = None
        self._written_in_cycle: int | None = None
        self._holds_camera = False
        self._frozen = False
        self._paused_by_us = False
        self._field_of_view_before: float | None = None
        self.error: str | None = None

    @property
    def frozen(self) -> bool:
        """Whether the flight model and time stand still on our account."""
        return self._frozen

    def freeze(self) -> None:
        """Stops flight model and time. Paused, X-Plane still draws and still takes poses, but nothing moves by itself."""
        if self._frozen:
            return
        self._frozen = True
        self._field_of_view_before = self._datarefs.get(names.FIELD_OF_VIEW)
        self._datarefs.set(names.OVERRIDE_FLIGHT_MODEL, 1)
        if not self.paused():
            self._pause("sim/operation/pause_on")
            self._paused_by_us = True

    def release(self) -> None:
        """Lets everything run again, as far as it was we who stopped it."""
        self._tick = None
        if self._holds_camera:
            self._holds_camera = False
            self._xp.dontControlCamera()
        if not self._frozen:
            return
        self._frozen = False
        if self._field_of_view_before is not None:
            self._datarefs.set(names.FIELD_OF_VIEW, self._field_of_view_before)
        self._datarefs.set(names.OVERRIDE_FLIGHT_MODEL, 0)
        if self._paused_by_us:
            self._paused_by_us = False
            if self.paused():
                self._pause("sim/operation/pause_off")

    def _pause(self, path: str) -> None:
        # Not every X-Plane 11 has the two commands; the toggle is as good, since we know the state.
        self.command(path if self._xp.findCommand(path) else "sim/operation/pause_toggle")

    def paused(self) -> bool:
        """Whether simulated time stands still."""
        return self._datarefs.get(names.PAUSED) != 0

    def scenery_is_loading(self) -> bool:
        """Whether X-Plane is loading scenery in the background; false where it does not say."""
        return self._datarefs.get_or(names.SCENERY_LOADING, 0.0) != 0

    def command(self, path: str) -> None:
        """Runs one of X-Plane's commands once; a missing one is noted in the log."""
        found = self._xp.findCommand(path)
        if found:
            self._xp.commandOnce(found)
        else:
            self._xp.log(f"this X-Plane has no command {path}")

    def show(self, tick: Tick) -> None:
        """From the next frame on, until told otherwise."""
        self._tick = tick
        self.error = None

    def keep_camera(self) -> None:
        """Takes the camera unless we have it."""
        if not self._holds_camera:
            self._holds_camera = True
            self._xp.controlCamera(self._xp.ControlCameraForever, self.on_camera, None)

    def written_in(self, cycle: int) -> bool:
        """Whether pose and camera were written in that frame, and nobody took the camera since."""
        return self._holds_camera and self._written_in_cycle == cycle

    def on_camera(self, position: list[float] | None, is_losing_control: int, _refcon: object) -> int:
        """X-Plane asks where the camera is. The list must be changed in place; 1 means that it was."""
        try:
            if is_losing_control:
                self._holds_camera = False
                return 0
            if self._tick is None or position is None:
                # Ours to hold, but nothing to show yet: X-Plane's own view.
                return 0
            self._write(self._tick, position)
            self._written_in_cycle = self._xp.getCycleNumber()
            return 1
        except Exception as error:  # Nothing may escape into X-Plane.
            self.error = f"cannot place aircraft and camera: {error!r}"
            return 0

    def _write(self, tick: Tick, position: list[float]) -> None:
        self.write_pose(tick.pose)
        self._write_controls(tick.flap_ratio, tick.gear_ratio)
        self._datarefs.set(names.FIELD_OF_VIEW, tick.hfov_deg)
        camera = self._frame.place(tick.camera)
        # Pitch comes before heading here, and the zoom is 1: the field of view is set.
        position[:] = [camera.x, camera.y, camera.z, camera.theta, camera.psi, camera.phi, 1.0]

    def write_pose(self, pose: Pose) -> None:
        """Puts the aircraft somewhere, converted with the local origin of this moment."""
        local = self._frame.place(pose)
        for name, value in zip(names.LOCAL_XYZ, (local.x, local.y, local.z)):
            self._datarefs.set(name, value)
        # The angles are what is drawn, the quaternion what the flight model goes on from: both, or one overwrites the other.
        for name, value in zip(names.ATTITUDE, (local.psi, local.theta, local.phi)):
            self._datarefs.set(name, value)
        self._datarefs.set_array(names.QUATERNION, local.quaternion())

    def _write_controls(self, flap_ratio: float, gear_ratio: float) -> None:
        self._datarefs.set_if_there(names.FLAPS_WANTED, flap_ratio)
        self._datarefs.set_if_there(names.FLAPS_DRAWN, flap_ratio)
        self._datarefs.set_if_there(names.GEAR_WANTED, 1 if gear_ratio > 0.5 else 0)
        self._datarefs.set_array(names.GEAR_DRAWN, [gear_ratio] * GEARS)

    def read_local_pose(self) -> LocalPose:
        """Where X-Plane has the aircraft, local coordinates."""
        return LocalPose(*(self._datarefs.get(name) for name in names.LOCAL_XYZ + names.ATTITUDE))

    def read_pose(self) -> Pose:
        """Where X-Plane has the aircraft."""
        return self._frame.read(self.read_local_pose())

    def read_camera(self) -> tuple[Pose, float]:
        """Where X-Plane has the camera, and its horizontal field of view."""
        x, y, z, heading, pitch, roll = (self._datarefs.get(name) for name in names.VIEW_POSE)
        camera = self._frame.read(LocalPose(x, y, z, wrapped_360(heading), pitch, roll))
        return camera, self._datarefs.get(names.FIELD_OF_VIEW)
