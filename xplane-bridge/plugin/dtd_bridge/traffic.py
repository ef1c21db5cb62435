"""No other aircraft while pictures are taken."""

from __future__ import annotations


from .messages import Refusal
from .xp_api import Xp


class Traffic:
    """X-Plane's AI aircraft, which a plugin switches off by taking control of them."""

    def __init__(self, xp: Xp) -> None:
        self._xp = xp
        self._holds = False
        self._found: int | None = None

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
        """Their previous number, and who requested the removal."""
        if self._holds:
            self._holds = False
            if self._found is not None:
                self._xp.setActiveAircraftCount(self._found)
            self._xp.releasePlanes()
