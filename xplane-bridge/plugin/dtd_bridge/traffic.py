"""No other aircraft while images are taken."""

from __future__ import annotations

from .datarefs import Datarefs
from .log import log
from .messages import Refusal
from .xp_api import Xp

COME_BACK = "X-Plane's own other aircraft come back with its next flight"


class Traffic:
    """X-Plane's AI aircraft, which a plugin switches off by taking control of them.

    X-Plane 12 was seen to hang for ever when a plugin releases the planes, or is disabled with them, while other aircraft are
    defined; a count of 1 before that avoids it. So there the count stays 1, and the aircraft return with the next flight.
    """

    def __init__(self, xp: Xp, datarefs: Datarefs) -> None:
        self._xp = xp
        self._datarefs = datarefs
        self._holds = False
        self._found = 1

    def clear(self) -> None:
        """Removes all aircraft except the user's. X-Plane brings the others back with every flight."""
        _, active, _ = self._xp.countAircraft()
        if active <= 1:
            return
        if not self._holds:
            if not self._xp.acquirePlanes():
                raise Refusal(
                    f"{active - 1} other aircraft fly, and another plugin holds them: switch off its traffic (TCAS, online networks), "
                    "or AI aircraft in Flight Configuration"
                )
            self._holds, self._found = True, active
        self._xp.setActiveAircraftCount(1)

    def give_back(self) -> None:
        """Releases the planes: in X-Plane 11 as many as there were, in 12 only the user's."""
        if not self._holds:
            return
        if self._datarefs.is_x_plane_11:
            self._xp.setActiveAircraftCount(self._found)
        else:
            self._xp.setActiveAircraftCount(1)
            if self._xp.countAircraft()[1] > 1:
                log(self._xp, f"other aircraft cannot be removed: they stay with this plugin. {COME_BACK}")
                return
            log(self._xp, f"the planes are released with a count of 1. {COME_BACK}")
        self._holds = False
        self._xp.releasePlanes()

    def what_is_left(self) -> list[str]:
        """For the log, while X-Plane disables the plugin: planes must not be released then."""
        return [f"the planes are not released, their count stays 1. {COME_BACK}"] if self._holds else []
