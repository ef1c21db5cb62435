"""Saves X-Plane's state for a client, and restores it.

Saved when a client greets, before it changes anything over any channel. Restored in two steps. View, pause and overrides return
when the client releases or leaves, also when it was killed: its connection ends with it. The weather's and the clock's own modes
return when no client has come back for a while: a run of `dtd` opens a new connection for every scenario, and after real weather
temperatures drift for minutes.
"""

from __future__ import annotations

import time

from . import datarefs as names
from .datarefs import Datarefs
from .log import log
from .xp_api import Xp

# Restored at once: written in this order, the switch of the vertical angle last.
OF_THE_STAGE = (
    *names.OVERRIDES, names.MOUSE_IS_YOKE, *names.LANDING_LIGHTS, names.FIELD_OF_VIEW, names.VERTICAL_FIELD_OF_VIEW, names.NON_PROPORTIONAL_VIEW,
)  # fmt: skip
# Restored at the end: real weather or a trend, the computer's clock.
OF_THE_WORLD = (names.CHANGE_MODE, names.USE_REAL_WEATHER, names.USE_SYSTEM_TIME)
# Longer than the pauses between scenarios.
COMES_BACK_WITHIN_S = 20.0
DEFAULT_VIEW = "sim/view/default_view"


class Found:
    """What is to be restored, if anything."""

    def __init__(self, xp: Xp, datarefs: Datarefs) -> None:
        self._xp = xp
        self._datarefs = datarefs
        self._values: dict[str, float] | None = None
        self._paused = False
        self._external = True
        self._left_at: float | None = None

    def remember(self) -> None:
        """A client begins: saves the state, unless an earlier one's has not been restored."""
        self._left_at = None
        if self._values is None:
            there = [name for name in (*OF_THE_STAGE, *OF_THE_WORLD) if self._datarefs.has(name)]
            self._values = {name: self._datarefs.get(name) for name in there}
            self._paused = self._datarefs.get(names.PAUSED) != 0
            self._external = self._datarefs.get_or(names.VIEW_IS_EXTERNAL, 1.0) != 0

    def give_back_the_stage(self) -> None:
        """View, overrides, pause."""
        if self._values is None:
            return
        if not self._external and self._datarefs.get_or(names.VIEW_IS_EXTERNAL, 0.0) != 0:
            command(self._xp, DEFAULT_VIEW)
        self._put_back(OF_THE_STAGE)
        set_pause(self._xp, self._datarefs, self._paused)

    def client_left(self) -> None:
        """No client is connected now."""
        if self._values is not None and self._left_at is None:
            self._left_at = time.monotonic()

    def step(self) -> None:
        """One frame: restores the rest if no client came back."""
        if self._left_at is not None and time.monotonic() - self._left_at > COMES_BACK_WITHIN_S:
            self.give_back_everything()

    def give_back_everything(self) -> None:
        """The stage, and the mode of weather and time."""
        self.give_back_the_stage()
        self._put_back(OF_THE_WORLD)
        self._values = self._left_at = None

    def give_back_values(self) -> None:
        """As far as that needs no command, while X-Plane disables the plugin."""
        self._put_back((*OF_THE_STAGE, *OF_THE_WORLD))

    def what_is_left(self) -> list[str]:
        """For the log, after that."""
        stays_paused = self._values is not None and not self._paused and self._datarefs.get(names.PAUSED) != 0
        return ["X-Plane stays paused, press P"] if stays_paused else []

    def _put_back(self, wanted: tuple[str, ...]) -> None:
        values = self._values or {}
        for name in wanted:
            if name in values and self._datarefs.get(name) != values[name]:
                self._datarefs.set(name, values[name])


def command(xp: Xp, path: str) -> None:
    """Runs one of X-Plane's commands once; a missing one is noted in the log."""
    found = xp.findCommand(path)
    if found:
        xp.commandOnce(found)
    else:
        log(xp, f"this X-Plane has no command {path}")


def set_pause(xp: Xp, datarefs: Datarefs, wanted: bool) -> None:
    """Stops simulated time, or lets it run."""
    if (datarefs.get(names.PAUSED) != 0) == wanted:
        return
    path = "sim/operation/pause_on" if wanted else "sim/operation/pause_off"
    # Not every X-Plane 11 has the two commands; the toggle is equivalent, since we know the state.
    command(xp, path if xp.findCommand(path) else "sim/operation/pause_toggle")
