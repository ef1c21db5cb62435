"""Access to X-Plane's datarefs by name, whatever their type, and the names that the plugin uses.

X-Plane 12 keeps most datarefs of 11 as deprecated: looking one up writes a complaint into Log.txt, and for some shows an error over the
scene. So a name that is not the running version's is not even looked up: :data:`ONLY_11` and :data:`ONLY_12` decide that for the whole
plugin. ``xplane-bridge/datarefs.csv`` has the successor of each.
"""

from __future__ import annotations

import re
from typing import Any, Sequence

from .messages import Refusal
from .xp_api import Xp

POSITION = "sim/flightmodel/position/"
LOCAL_XYZ = (POSITION + "local_x", POSITION + "local_y", POSITION + "local_z")
LOCAL_VELOCITY = (POSITION + "local_vx", POSITION + "local_vy", POSITION + "local_vz")
ATTITUDE = (POSITION + "psi", POSITION + "theta", POSITION + "phi")
ROTATION_RATES = (POSITION + "P", POSITION + "Q", POSITION + "R")
QUATERNION = POSITION + "q"
TRUE_AIRSPEED = POSITION + "true_airspeed"
ON_GROUND = "sim/flightmodel/failures/onground_any"
HAS_CRASHED = "sim/flightmodel2/misc/has_crashed"
ENGINE_COUNT = "sim/aircraft/engine/acf_num_engines"
ENGINES_RUNNING = "sim/flightmodel/engine/ENGN_running"

OVERRIDE_FLIGHT_MODEL = "sim/operation/override/override_planepath[0]"
# While the aircraft is posed nothing else may move it: not the flight model, no stick (whose cross shows in the picture), no lever.
OVERRIDES = (
    OVERRIDE_FLIGHT_MODEL,
    "sim/operation/override/override_joystick",
    "sim/operation/override/override_flightcontrol",
    "sim/operation/override/override_throttles",
)
# Airliners land with them on, also by day; the newer name has a switch for each. X-Plane switches on the airport's lights itself at
# dusk and in poor visibility.
LANDING_LIGHTS = (
    "sim/cockpit/electrical/landing_lights_on",
    *(f"sim/cockpit2/switches/landing_lights_switch[{at}]" for at in range(4)),
)  # fmt: skip
MOUSE_IS_YOKE = "sim/joystick/mouse_is_yoke"
IS_IN_REPLAY = "sim/time/is_in_replay"
POP_UPS = "sim/cockpit2/radios/indicators/show_popup"
PAUSED = "sim/time/paused"
# Simulated time since the flight began: stands still in a pause. 32 bits: it steps by 0.5 ms after an hour and a half.
FLIGHT_TIME_S = "sim/time/total_flight_time_sec"
USE_SYSTEM_TIME = "sim/time/use_system_time"
DATE_DAYS = "sim/time/local_date_days"
ZULU_TIME_S = "sim/time/zulu_time_sec"
# X-Plane 12's trend of the weather, 7 for real weather; X-Plane 11's switch.
CHANGE_MODE = "sim/weather/region/change_mode"
USE_REAL_WEATHER = "sim/weather/use_real_weather_bool"
# The exposure of X-Plane 12, which adapts to the scene.
EXPOSURE_EV100 = "sim/private/controls/photometric/ev100"
SCENERY_LOADING = "sim/graphics/scenery/async_scenery_load_in_progress"

VIEW = "sim/graphics/view/"
VIEW_POSE = tuple(VIEW + name for name in ("view_x", "view_y", "view_z", "view_heading", "view_pitch", "view_roll"))
FIELD_OF_VIEW = VIEW + "field_of_view_deg"
VERTICAL_FIELD_OF_VIEW = VIEW + "vertical_field_of_view_deg"
# 1 lets the vertical angle be written; with 0 the window's shape decides.
NON_PROPORTIONAL_VIEW = "sim/graphics/settings/non_proportional_vertical_FOV"
VIEW_IS_EXTERNAL = VIEW + "view_is_external"
WINDOW_SIZE = (VIEW + "window_width", VIEW + "window_height")
MODERN_DRIVER = VIEW + "using_modern_driver"
VERSION = "sim/version/xplane_internal_version"

# Current positions of flaps and gear, to be read; what requests them; and what is drawn. X-Plane 12 has no successor of the drawn ones
# that can be written: its deploy ratios follow the handles at their own pace, and not at all in a pause.
FLAPS_NOW = "sim/flightmodel2/controls/flap1_deploy_ratio"
GEAR_NOW = "sim/flightmodel2/gear/deploy_ratio[0]"
FLAPS_WANTED = ("sim/cockpit2/controls/flap_handle_request_ratio", "sim/cockpit2/controls/flap_ratio")
FLAPS_DRAWN = ("sim/flightmodel/controls/flaprat", "sim/flightmodel/controls/flap2rat")
GEAR_WANTED = ("sim/cockpit2/controls/gear_handle_down", "sim/cockpit/switches/gear_handle_status")
GEAR_DRAWN = "sim/aircraft/parts/acf_gear_deploy"

NAV1_FREQUENCY_10KHZ = "sim/cockpit/radios/nav1_freq_hz"
NAV1_COURSE_MAGNETIC = "sim/cockpit/radios/nav1_obs_degm"
# 0 is the first receiver; the autopilot follows it.
HSI_SOURCE = "sim/cockpit2/radios/actuators/HSI_source_select_pilot"
HEADING_BUG_MAGNETIC = "sim/cockpit/autopilot/heading_mag"
AUTOPILOT_ELECTRIC_MASTER = "sim/cockpit2/autopilot/autopilot_electric_master"
AIRSPEED_IS_MACH = "sim/cockpit2/autopilot/airspeed_is_mach"
AUTOPILOT_MODE = "sim/cockpit/autopilot/autopilot_mode"
AUTOTHROTTLE = "sim/cockpit2/autopilot/autothrottle_enabled"
NAV_STATUS = "sim/cockpit2/autopilot/nav_status"
GLIDE_SLOPE_STATUS = "sim/cockpit2/autopilot/glideslope_status"
APPROACH_STATUS = "sim/cockpit2/autopilot/approach_status"
ALTITUDE_HOLD_STATUS = "sim/cockpit2/autopilot/altitude_hold_status"
VERTICAL_SPEED_STATUS = "sim/cockpit2/autopilot/vvi_status"
AIRSPEED_DIAL_KT = "sim/cockpit2/autopilot/airspeed_dial_kts"
ALTITUDE_DIAL_FT = "sim/cockpit/autopilot/altitude"
VERTICAL_SPEED_FPM = "sim/cockpit/autopilot/vertical_velocity"

# Datarefs of X-Plane 11 that 12 has replaced, or has no use for here.
ONLY_11 = frozenset({
    USE_REAL_WEATHER, MODERN_DRIVER, LANDING_LIGHTS[0], FLAPS_WANTED[1], GEAR_WANTED[1],
})  # fmt: skip
# Datarefs that came with X-Plane 12.
ONLY_12 = frozenset({CHANGE_MODE, FLAPS_WANTED[0], EXPOSURE_EV100})
# Deprecated in X-Plane 12, and used there all the same: nothing else can be written.
WITHOUT_SUCCESSOR = frozenset({*FLAPS_DRAWN, GEAR_DRAWN})

PUBLISHED_PORT = "dtd/bridge/capture_port"
PUBLISHED_WEATHER_SETTLE_S = "dtd/bridge/weather_settle_s"

# From this number on it is X-Plane 12.
FIRST_OF_12 = 120_000

_ELEMENT = re.compile(r"^(.*)\[(\d+)\]$")


class Datarefs:
    """Reads and writes by name; ``name[3]`` is one element of an array. Handles are cached, missing ones as well."""

    def __init__(self, xp: Xp) -> None:
        self._xp = xp
        self._known: dict[str, tuple[Any, int, int | None] | None] = {}
        self._is_x_plane_11: bool | None = None

    @property
    def is_x_plane_11(self) -> bool:
        """Whether the running version is 11."""
        if self._is_x_plane_11 is None:
            self._is_x_plane_11 = self.get_or(VERSION, 0.0) < FIRST_OF_12
        return self._is_x_plane_11

    def forget_missing(self) -> None:
        """Looks for missing ones again: an aircraft may have been loaded."""
        self._known = {name: found for name, found in self._known.items() if found is not None}

    def has(self, name: str) -> bool:
        """Whether this X-Plane has it."""
        return self._find(name) is not None

    def get(self, name: str) -> float:
        """Its value with full precision; rejects a name that X-Plane lacks."""
        xp, (ref, kinds, index) = self._xp, self._must(name)
        if index is not None:
            if kinds & xp.Type_FloatArray:
                floats: list[float] = []
                xp.getDatavf(ref, floats, index, 1)
                return float(floats[0])
            integers: list[int] = []
            xp.getDatavi(ref, integers, index, 1)
            return float(integers[0])
        if kinds & xp.Type_Double:
            return float(xp.getDatad(ref))
        if kinds & xp.Type_Float:
            return float(xp.getDataf(ref))
        return float(xp.getDatai(ref))

    def get_or(self, name: str, default: float) -> float:
        """Its value, or another where X-Plane lacks it."""
        return self.get(name) if self.has(name) else default

    def set(self, name: str, value: float) -> None:
        """Writes it; rejects a name that X-Plane lacks."""
        xp, (ref, kinds, index) = self._xp, self._must(name)
        if index is not None:
            self._set_array(ref, kinds, [value], index)
        elif kinds & xp.Type_Double:
            xp.setDatad(ref, float(value))
        elif kinds & xp.Type_Float:
            xp.setDataf(ref, float(value))
        else:
            xp.setDatai(ref, int(value))

    def set_if_there(self, names: Sequence[str], value: float) -> None:
        """Writes those of several names that X-Plane has."""
        for name in names:
            if self.has(name):
                self.set(name, value)

    def set_array(self, name: str, values: Sequence[float]) -> None:
        """Writes the first elements of an array, if X-Plane has it."""
        if self.has(name):
            ref, kinds, _ = self._must(name)
            self._set_array(ref, kinds, list(values), 0)

    def fill(self, name: str, value: float) -> None:
        """Writes all elements of an array, if X-Plane has it."""
        if self.has(name):
            ref, kinds, _ = self._must(name)
            xp = self._xp
            count = xp.getDatavf(ref) if kinds & xp.Type_FloatArray else xp.getDatavi(ref)
            self._set_array(ref, kinds, [value] * count, 0)

    def _set_array(self, ref: Any, kinds: int, values: list[float], offset: int) -> None:
        if kinds & self._xp.Type_FloatArray:
            self._xp.setDatavf(ref, [float(v) for v in values], offset, len(values))
        else:
            self._xp.setDatavi(ref, [int(v) for v in values], offset, len(values))

    def _must(self, name: str) -> tuple[Any, int, int | None]:
        found = self._find(name)
        if found is None:
            raise Refusal(f"this X-Plane has no dataref {name}")
        return found

    def _find(self, name: str) -> tuple[Any, int, int | None] | None:
        if name not in self._known:
            match = _ELEMENT.match(name)
            whole = match.group(1) if match else name
            ref = self._xp.findDataRef(whole) if self._is_of_this_version(name, whole) else None
            self._known[name] = (ref, self._xp.getDataRefTypes(ref), int(match.group(2)) if match else None) if ref else None
        return self._known[name]

    def _is_of_this_version(self, *names: str) -> bool:
        """Whether the running version is to be asked for it; the version itself is."""
        if VERSION in names:
            return True
        return (ONLY_12 if self.is_x_plane_11 else ONLY_11).isdisjoint(names)
