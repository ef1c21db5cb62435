"""The plugin's flight loops, all created while it is enabled.

Since 12.4 X-Plane checks what is called where. A loop after the flight model may only patch values; whatever creates, takes planes,
counts aircraft or runs commands has to come from a loop before it, which X-Plane calls in every frame, also while paused.
"""

from __future__ import annotations

from typing import Any, Callable

from .log import Faults
from .xp_api import OnFrame, Xp

EVERY_FRAME = -1.0
NOT_AGAIN = 0.0


class FlightLoops:
    """A loop before the flight model, one after it, and one that runs a single call later, before the flight model."""

    def __init__(self, xp: Xp, faults: Faults, before: Callable[[], None], after: Callable[[], None]) -> None:
        self._xp = xp
        self._faults = faults
        self._later: Callable[[], None] | None = None
        phases = (xp.FlightLoop_Phase_BeforeFlightModel, xp.FlightLoop_Phase_AfterFlightModel)
        self._each_frame = [
            xp.createFlightLoop(self._guarded(name, run), phase, None)
            for name, run, phase in zip(("the loop before the flight model", "the loop after the flight model"), (before, after), phases)
        ]
        self._once = xp.createFlightLoop(self._run_once, phases[0], None)
        for loop in self._each_frame:
            xp.scheduleFlightLoop(loop, EVERY_FRAME, 1)

    def once(self, call: Callable[[], None], delay_s: float) -> None:
        """Runs a call later, from a callback of its own. Another call that is still pending is dropped."""
        self._later = call
        self._xp.scheduleFlightLoop(self._once, delay_s, 1)

    def forget(self) -> None:
        """Drops a pending call."""
        self._later = None

    def close(self) -> None:
        """Destroys the loops."""
        while self._each_frame:
            self._xp.destroyFlightLoop(self._each_frame.pop())
        if self._once is not None:
            self._xp.destroyFlightLoop(self._once)
            self._once = None

    def _guarded(self, name: str, run: Callable[[], None]) -> OnFrame:
        def on_frame(_since_last: float, _since_loop: float, _counter: int, _refcon: Any) -> float:
            try:
                run()
            except Exception as error:
                self._faults.caught(name, error)
            return EVERY_FRAME

        return on_frame

    def _run_once(self, _since_last: float, _since_loop: float, _counter: int, _refcon: Any) -> float:
        try:
            call, self._later = self._later, None
            if call is not None:
                call()
        except Exception as error:
            self._faults.caught("a single call", error)
        return NOT_AGAIN
