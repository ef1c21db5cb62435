"""X-Plane's autopilot: switched by its commands, verified by its datarefs.

Most of its commands are toggle buttons. So a command is sent once, only while the datarefs say that something is not as wanted, and
nothing else is sent before its effect shows. Only this module sends them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from . import datarefs as names
from .datarefs import Datarefs
from .log import log
from .messages import Refusal
from .stage import Stage
from .xp_api import Xp

# A command shows within a frame or two. After this many frames the aircraft does not show it.
PATIENCE_FRAMES = 120

# A dataref, and its minimum while something is on: most read 0 off, 1 armed, 2 captured.
State = tuple[str, int]


@dataclass(frozen=True)
class Switch:
    """A wanted state of one part of the autopilot."""

    what: str
    command: str
    # On while all states of one of these are.
    on_while: tuple[tuple[State, ...], ...]
    on: bool = True
    # Without it there is no flight; for the rest, aircraft show different things, and the flight shows whether they are on.
    needed: bool = False


_NAV, _GLIDE_SLOPE, _APPROACH = ((name, 1) for name in (names.NAV_STATUS, names.GLIDE_SLOPE_STATUS, names.APPROACH_STATUS))

SERVOS = Switch("the servos", "sim/autopilot/servos_on", (((names.AUTOPILOT_MODE, 2),),), needed=True)
AUTOTHROTTLE = Switch("the autothrottle", "sim/autopilot/autothrottle_on", (((names.AUTOTHROTTLE, 1),),))
# The button for both may show as itself or as the two that it arms.
LOCALIZER = Switch("the localizer", "sim/autopilot/NAV", ((_NAV,), (_APPROACH,)))
APPROACH = Switch("the approach", "sim/autopilot/approach", ((_APPROACH,), (_NAV, _GLIDE_SLOPE)))
GLIDE_SLOPE = Switch("the glide slope", "sim/autopilot/glide_slope", ((_GLIDE_SLOPE,),))
ALTITUDE_HOLD = Switch("the altitude", "sim/autopilot/altitude_hold", (((names.ALTITUDE_HOLD_STATUS, 1),),))
VERTICAL_SPEED = Switch("the vertical speed", "sim/autopilot/vertical_speed", (((names.VERTICAL_SPEED_STATUS, 1),),))

# Modes captured during the previous flight must not affect this one: a glide slope, or another flight's altitude.
FROM_SCRATCH = (
    SERVOS,
    AUTOTHROTTLE,
    Switch("the last glide slope", GLIDE_SLOPE.command, GLIDE_SLOPE.on_while, on=False),
    Switch("the last approach", APPROACH.command, ((_APPROACH,),), on=False),
    Switch("the last altitude", ALTITUDE_HOLD.command, ALTITUDE_HOLD.on_while, on=False),
    LOCALIZER,
)
# Localizer and glide path: by the button for both, then by the button of whichever does not show.
CAPTURE = (APPROACH, LOCALIZER, GLIDE_SLOPE)


class Autopilot:
    """Establishes the wanted states in order, one step per frame."""

    def __init__(self, stage: Stage, datarefs: Datarefs, xp: Xp) -> None:
        self._stage = stage
        self._datarefs = datarefs
        self._xp = xp
        self._wanted: deque[Switch] = deque()
        # Frames since the command of the first one was sent.
        self._waited: int | None = None

    @property
    def busy(self) -> bool:
        """Whether something is still pending."""
        return bool(self._wanted)

    def want(self, *switches: Switch) -> None:
        """Queues these states after the earlier ones."""
        self._wanted.extend(switches)

    def step(self) -> None:
        """As far as possible in this frame."""
        while self._wanted:
            switch = self._wanted[0]
            if not self._is_as_wanted(switch):
                if self._waited is None:
                    self._waited = 0
                    self._stage.command(switch.command)
                    if not self._is_as_wanted(switch):
                        return
                elif self._waited < PATIENCE_FRAMES:
                    self._waited += 1
                    return
                else:
                    self._give_up(switch)
            self._wanted.popleft()
            self._waited = None

    def _is_as_wanted(self, switch: Switch) -> bool:
        return switch.on == any(all(self._reads(*state) for state in states) for states in switch.on_while)

    def _reads(self, name: str, least: int) -> bool:
        return self._datarefs.get_or(name, 0.0) >= least

    def _give_up(self, switch: Switch) -> None:
        found = ", ".join(
            f"{name} is {self._datarefs.get(name):.0f}" if self._datarefs.has(name) else f"there is no {name}"
            for name in dict.fromkeys(name for states in switch.on_while for name, _ in states)
        )
        wanted = "on" if switch.on else "off"
        text = f"the autopilot does not show {switch.what} {wanted} after {switch.command}: {found}"
        if switch.needed:
            raise Refusal(f"{text}. Fly an aircraft that has an autopilot, with its power on and nothing failed")
        log(self._xp, text)
