"""An in-memory world for tests of the plugin alone: WGS-84, a local origin that can move, an aircraft with an autopilot that
descends along a glide path once localizer and glide slope are on, and otherwise flies level."""

from __future__ import annotations

import math

from fake_xp import Kind, as_float32

A, F = 6_378_137.0, 1 / 298.257223563
E2 = F * (2 - F)
GROUND_MSL_M = 6.71
PERIOD_S = 0.25

DATAREFS = {
    "sim/version/xplane_internal_version": (Kind("int", None, False), 115_501),
    "sim/time/paused": (Kind("int", None, False), 0),
    # Not the time that passes in a frame, as in an X-Plane with slow frames: summing it up gives a wrong result.
    "sim/operation/misc/frame_rate_period": (Kind("float", None, False), 0.8 * PERIOD_S),
    "sim/time/total_flight_time_sec": (Kind("float", None, False), 5_000),
    "sim/operation/override/override_planepath": (Kind("int", 20), 0),
    "sim/graphics/scenery/async_scenery_load_in_progress": (Kind("int", None, False), 0),
    "sim/graphics/view/using_modern_driver": (Kind("int", None, False), 0),
    "sim/graphics/view/window_width": (Kind("int", None, False), 64),
    "sim/graphics/view/window_height": (Kind("int", None, False), 48),
    "sim/graphics/view/field_of_view_deg": (Kind("float"), 60),
    "sim/graphics/view/vertical_field_of_view_deg": (Kind("float"), 45),
    "sim/graphics/settings/non_proportional_vertical_FOV": (Kind("int"), 0),
    # In the cockpit, as after every start.
    "sim/graphics/view/view_is_external": (Kind("int", None, False), 0),
    "sim/time/use_system_time": (Kind("int"), 1),
    "sim/time/local_date_days": (Kind("int"), 10),
    "sim/time/zulu_time_sec": (Kind("float"), 3_600),
    "sim/time/is_in_replay": (Kind("int", None, False), 0),
    "sim/weather/use_real_weather_bool": (Kind("int"), 1),
    "sim/joystick/mouse_is_yoke": (Kind("int"), 1),
    **{f"sim/operation/override/override_{name}": (Kind("int"), 0) for name in ("joystick", "flightcontrol", "throttles")},
    "sim/cockpit2/radios/indicators/show_popup": (Kind("int", 4), 1),
    "sim/cockpit2/autopilot/autopilot_electric_master": (Kind("int"), 0),
    "sim/cockpit2/autopilot/airspeed_is_mach": (Kind("int"), 1),
    "sim/cockpit2/radios/actuators/HSI_source_select_pilot": (Kind("int"), 2),
    "sim/cockpit/autopilot/heading_mag": (Kind("float"), 0),
    **{
        f"sim/graphics/view/view_{name}": (Kind("float", None, False), 0)
        for name in ("x", "y", "z", "pitch", "heading", "roll")
    },
    **{f"sim/flightmodel/position/local_{name}": (Kind("double"), 0) for name in "xyz"},
    **{f"sim/flightmodel/position/local_v{name}": (Kind("float"), 0) for name in "xyz"},
    **{f"sim/flightmodel/position/{name}": (Kind("float"), 0) for name in ("psi", "theta", "phi", "P", "Q", "R")},
    "sim/flightmodel/position/q": (Kind("float", 4), 0),
    "sim/flightmodel/position/true_airspeed": (Kind("float", None, False), 0),
    "sim/flightmodel/position/indicated_airspeed": (Kind("float", None, False), 0),
    "sim/flightmodel/failures/onground_any": (Kind("int", None, False), 0),
    # X-Plane 12 has its own names and keeps those of 11.
    "sim/weather/region/change_mode": (Kind("int"), 7),
    "sim/cockpit2/controls/flap_handle_request_ratio": (Kind("float"), 0),
    "sim/cockpit2/controls/flap_ratio": (Kind("float"), 0),
    "sim/cockpit/switches/gear_handle_status": (Kind("int"), 1),
    "sim/cockpit/electrical/landing_lights_on": (Kind("int"), 0),
    "sim/cockpit2/switches/landing_lights_switch": (Kind("float", 16), 0),
    "sim/flightmodel2/controls/flap1_deploy_ratio": (Kind("float", None, False), 0),
    "sim/flightmodel2/gear/deploy_ratio": (Kind("float", 10, False), 1),
    "sim/flightmodel/controls/flaprat": (Kind("float"), 0),
    "sim/cockpit2/controls/gear_handle_down": (Kind("int"), 1),
    "sim/aircraft/parts/acf_gear_deploy": (Kind("float", 10), 0),
    "sim/cockpit/radios/nav1_freq_hz": (Kind("int"), 0),
    "sim/cockpit/radios/nav1_obs_degm": (Kind("float"), 0),
    "sim/aircraft/engine/acf_num_engines": (Kind("int", None, False), 2),
    # Parked, cold and dark.
    "sim/flightmodel/engine/ENGN_running": (Kind("int", 8, False), 0),
    "sim/cockpit/autopilot/autopilot_mode": (Kind("int"), 0),
    "sim/cockpit2/autopilot/autothrottle_enabled": (Kind("int"), 0),
    **{
        f"sim/cockpit2/autopilot/{mode}_status": (Kind("int", None, False), 0)
        for mode in ("nav", "glideslope", "approach", "altitude_hold", "vvi")
    },
    "sim/cockpit2/autopilot/airspeed_dial_kts": (Kind("float"), 0),
    "sim/cockpit/autopilot/altitude": (Kind("float"), 0),
    "sim/cockpit/autopilot/vertical_velocity": (Kind("float"), 0),
}
COMMANDS = {
    "sim/operation/pause_on", "sim/operation/pause_off", "sim/operation/pause_toggle", "sim/operation/fix_all_systems",
    "sim/operation/regen_weather", "sim/view/free_camera", "sim/view/default_view",
    "sim/autopilot/servos_on", "sim/autopilot/autothrottle_on", "sim/autopilot/NAV", "sim/autopilot/approach",
    "sim/autopilot/glide_slope", "sim/autopilot/altitude_hold", "sim/autopilot/vertical_speed",
}  # fmt: skip


def ecef(latitude: float, longitude: float, altitude: float) -> tuple[float, float, float]:
    la, lo = math.radians(latitude), math.radians(longitude)
    n = A / math.sqrt(1 - E2 * math.sin(la) ** 2)
    across = (n + altitude) * math.cos(la)
    return across * math.cos(lo), across * math.sin(lo), (n * (1 - E2) + altitude) * math.sin(la)


def geodetic(x: float, y: float, z: float) -> tuple[float, float, float]:
    across = math.hypot(x, y)
    latitude = math.atan2(z, across * (1 - E2))
    for _ in range(8):
        n = A / math.sqrt(1 - E2 * math.sin(latitude) ** 2)
        altitude = across / math.cos(latitude) - n
        latitude = math.atan2(z, across * (1 - E2 * n / (n + altitude)))
    return math.degrees(latitude), math.degrees(math.atan2(y, x)), altitude


# Toggle buttons.
TOGGLES = {
    "NAV": "nav_status", "glide_slope": "glideslope_status", "altitude_hold": "altitude_hold_status", "vertical_speed": "vvi_status",
}  # fmt: skip
# Only one of the vertical modes is engaged at a time.
EXCLUDES = {"altitude_hold": "vvi_status", "vertical_speed": "altitude_hold_status"}
STATUS = "sim/cockpit2/autopilot/"


class PaperWorld:
    """Implements ``fake_xp.World``."""

    def __init__(self) -> None:
        self.values = {name: [float(first)] * (kind.length or 1) for name, (kind, first) in DATAREFS.items()}
        self.kinds = {name: kind for name, (kind, _) in DATAREFS.items()}
        self.origin = (1.0, 104.0)
        self.commands: list[str] = []
        self.published: dict[str, float] = {}
        self.cycle = 100
        self.known_commands = set(COMMANDS)
        # Buttons of the autopilot that do nothing, engines that do not start.
        self.dead_buttons: set[str] = set()
        self.dead_engines: set[int] = set()
        self.ground_is_loaded = True
        # Other aircraft, and how often the camera was taken away.
        self.others = False
        self.lost_cameras = 0
        self.rendered: list[tuple[float, ...]] = []
        # Drawing lags by this many frames.
        self.lag_frames = 0
        self.shown: list[int] = [0]
        # Whether every picture differs from the one before, as in rain.
        self.rains = False
        self.path = ""
        # Whether the view returns to X-Plane's own once nobody controls the camera.
        self.own_view = False
        # Called at the beginning of each frame, to inject faults.
        self.disturb = lambda world: None

    def kind(self, name: str) -> Kind | None:
        return self.kinds.get(name)

    def get(self, name: str, index: int = 0) -> float:
        return self.values[name][index]

    def set(self, name: str, index: int, value: float) -> None:
        self.values[name][index] = value

    def knows_command(self, path: str) -> bool:
        return path in self.known_commands

    def command(self, path: str) -> None:
        self.commands.append(path)
        paused = {"pause_on": 1.0, "pause_off": 0.0, "pause_toggle": 1.0 - self.get("sim/time/paused")}
        name = path.rsplit("/", 1)[1]
        if path.startswith("sim/view/"):
            self.set("sim/graphics/view/view_is_external", 0, float(name == "free_camera"))
        if name in paused:
            self.set("sim/time/paused", 0, paused[name])
        # Stricter than X-Plane is known to be: on the ground, or stopped, the autopilot accepts nothing.
        if path.startswith("sim/autopilot/") and self._is_flying() and name not in self.dead_buttons:
            self._autopilot(name)

    def status(self, mode: str) -> bool:
        """Whether a mode of the autopilot is armed or captured."""
        return self.get(f"{STATUS}{mode}_status") > 0

    def _autopilot(self, name: str) -> None:
        if name == "servos_on":
            self.set("sim/cockpit/autopilot/autopilot_mode", 0, 2)
        elif name == "autothrottle_on":
            self.set(STATUS + "autothrottle_enabled", 0, 1)
        elif name in TOGGLES:
            on = not self.get(STATUS + TOGGLES[name])
            self.set(STATUS + TOGGLES[name], 0, float(on))
            if on and name in EXCLUDES:
                self.set(STATUS + EXCLUDES[name], 0, 0)
            # A mode holds the current value until another one is dialled.
            if name == "vertical_speed" and on:
                self.set("sim/cockpit/autopilot/vertical_velocity", 0, 0)
            if name == "altitude_hold" and on:
                at = self.local_to_world(*(self.get(f"sim/flightmodel/position/local_{axis}") for axis in "xyz"))
                self.set("sim/cockpit/autopilot/altitude", 0, round(at[2] / 0.3048, -2))
        elif name == "approach":
            on = not self.status("approach")
            for mode in ("nav", "glideslope"):
                self.set(f"{STATUS}{mode}_status", 0, float(on))
        # Armed together they are the approach, however they were armed.
        self.set(STATUS + "approach_status", 0, float(self.status("nav") and self.status("glideslope")))

    def _is_flying(self) -> bool:
        free = self.get("sim/operation/override/override_planepath") == 0 and self.get("sim/time/paused") == 0
        moving = any(self.get(f"sim/flightmodel/position/local_v{axis}") for axis in "xyz")
        return free and moving and not self.get("sim/flightmodel/failures/onground_any")

    def place_user(self, latitude: float, longitude: float, altitude: float, heading: float, speed: float) -> None:
        """X-Plane's air start: another flight, with the engines running."""
        for axis, value in zip("xyz", self.world_to_local(latitude, longitude, altitude)):
            self.set(f"sim/flightmodel/position/local_{axis}", 0, value)
        velocity = (speed * math.sin(math.radians(heading)), 0.0, -speed * math.cos(math.radians(heading)))
        for axis, value in zip("xyz", velocity):
            self.set(f"sim/flightmodel/position/local_v{axis}", 0, value)
        for engine in range(int(self.get("sim/aircraft/engine/acf_num_engines"))):
            self.set("sim/flightmodel/engine/ENGN_running", engine, float(engine not in self.dead_engines))
        self.set("sim/flightmodel/failures/onground_any", 0, 0)
        self.set("sim/time/total_flight_time_sec", 0, 0)

    def world_to_local(self, latitude: float, longitude: float, altitude: float) -> tuple[float, float, float]:
        here, origin = ecef(latitude, longitude, altitude), ecef(*self.origin, 0.0)
        d = tuple(a - b for a, b in zip(here, origin))
        east, up, south = self._axes()
        return tuple(sum(a * b for a, b in zip(axis, d)) for axis in (east, up, south))

    def local_to_world(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        east, up, south = self._axes()
        origin = ecef(*self.origin, 0.0)
        return geodetic(*(o + x * e + y * u + z * s for o, e, u, s in zip(origin, east, up, south)))

    def _axes(self) -> tuple[tuple[float, ...], ...]:
        la, lo = (math.radians(a) for a in self.origin)
        east = (-math.sin(lo), math.cos(lo), 0.0)
        up = (math.cos(la) * math.cos(lo), math.cos(la) * math.sin(lo), math.sin(la))
        south = (math.sin(la) * math.cos(lo), math.sin(la) * math.sin(lo), -math.cos(la))
        return east, up, south

    def ground_below(self, x: float, y: float, z: float) -> tuple[float, float, float] | None:
        """Along the local y axis, as X-Plane's probes look."""
        if not self.ground_is_loaded:
            return None
        for _ in range(6):
            y -= self.local_to_world(x, y, z)[2] - GROUND_MSL_M
        return x, y, z

    def publish(self, name: str, value: float) -> None:
        self.published[name] = value

    def begin_frame(self) -> int:
        self.cycle += 1
        self.disturb(self)
        if self.get("sim/time/paused") == 0:
            time = "sim/time/total_flight_time_sec"
            self.set(time, 0, as_float32(self.get(time) + PERIOD_S))
        if self._is_flying():
            self._slide()
        return self.cycle

    def _slide(self) -> None:
        """Along the velocity, descending at 3 degrees once the autopilot follows localizer and glide slope."""
        position = "sim/flightmodel/position/"
        velocity = [self.get(f"{position}local_v{axis}") for axis in "xyz"]
        speed = math.hypot(*velocity)
        x, y, z = (
            self.get(f"{position}local_{axis}") + v * PERIOD_S for axis, v in zip("xyz", velocity)
        )
        latitude, longitude, altitude = self.local_to_world(x, y, z)
        if self.get("sim/cockpit/autopilot/autopilot_mode") == 2 and self.status("nav") and self.status("glideslope"):
            altitude -= speed * PERIOD_S * math.tan(math.radians(3))
        if altitude <= GROUND_MSL_M + 3:
            self.set("sim/flightmodel/failures/onground_any", 0, 1)
        for axis, value in zip("xyz", self.world_to_local(latitude, longitude, altitude)):
            self.set(f"{position}local_{axis}", 0, value)
        self.set(position + "true_airspeed", 0, speed)
        self.set("sim/flightmodel2/controls/flap1_deploy_ratio", 0, self.get("sim/cockpit2/controls/flap_ratio"))

    def move_origin(self, latitude: float, longitude: float) -> None:
        """As X-Plane does when it loads scenery: the aircraft stays where it is on earth."""
        position = "sim/flightmodel/position/local_"
        at = self.local_to_world(*(self.get(position + axis) for axis in "xyz"))
        self.origin = (latitude, longitude)
        for axis, value in zip("xyz", self.world_to_local(*at)):
            self.set(position + axis, 0, value)

    def place_camera(self, position: list[float] | None) -> None:
        self.shown = [*self.shown, self.colour()][-1 - self.lag_frames :]
        if position is None and self.own_view:
            self.set("sim/graphics/view/view_heading", 0, 0.0)
        if position is not None:
            for name, value in zip(("x", "y", "z", "pitch", "heading", "roll"), position):
                self.set(f"sim/graphics/view/view_{name}", 0, value)

    def lose_camera(self) -> None:
        self.lost_cameras += 1

    def others_fly(self) -> bool:
        return self.others

    def let_others_fly(self, fly: bool) -> None:
        self.others = fly

    def system_path(self) -> str:
        return self.path

    def render(self, width: int, height: int, windows: bool = False) -> bytes:
        """Red grows to the right, green downwards, blue encodes the aircraft's position some frames ago; a window has the first
        pixel, rain the second, and the last one shows where the camera looks."""
        self.rendered.append(tuple(self.get(f"sim/graphics/view/view_{name}") for name in ("x", "y", "z")))
        blue = self.shown[0]
        rgb = bytearray(b"".join(bytes((x % 256, y % 256, blue)) for y in range(height) for x in range(width)))
        rgb[-3:] = bytes((0, int(self.get("sim/graphics/view/view_heading")) % 256, blue))
        if self.rains:
            rgb[3] = len(self.rendered) % 256
        if windows:
            rgb[:3] = b"\xff\x00\xff"
        return bytes(rgb)

    def colour(self) -> int:
        """Of an aircraft here."""
        return int(abs(self.get("sim/flightmodel/position/local_z"))) % 256
