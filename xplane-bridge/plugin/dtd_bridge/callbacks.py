"""The order of X-Plane's callbacks within a frame. Nothing here relies on it; ``dtd doctor`` records it, since reports differ."""

from __future__ import annotations

from collections import Counter
from typing import Any, Generator

from .xp_api import Xp

BEFORE, AFTER, CAMERA, DRAW = "before_flight_model", "after_flight_model", "camera", "draw"
# Of the draw callback that exists while the order is watched: after the windows.
DRAWN_AFTER = 0


class Callbacks:
    """Each callback reports here; the reports are dropped unless somebody watches."""

    def __init__(self, xp: Xp) -> None:
        self._xp = xp
        self._seen: list[str] | None = None

    def note(self, what: str) -> None:
        """This callback was called."""
        if self._seen is not None:
            self._seen.append(what)

    def watch(self, frames: int) -> Generator[None, None, dict[str, Any]]:
        """For this many frames: how often each order occurred, and how far X-Plane's cycle number advanced."""
        on_draw = self._on_draw
        self._xp.registerDrawCallback(on_draw, self._xp.Phase_Window, DRAWN_AFTER, None)
        try:
            self._seen = []
            cycle = self._xp.getCycleNumber()
            for _ in range(frames + 1):
                yield
            cycles = self._xp.getCycleNumber() - cycle
            return {"frames": frames, "cycles": round(cycles * frames / (frames + 1)), "orders": self._orders()}
        finally:
            self._seen = None
            self._xp.unregisterDrawCallback(on_draw, self._xp.Phase_Window, DRAWN_AFTER, None)

    def _orders(self) -> dict[str, int]:
        """Frames begin with the callback before the flight model; the first and the last may be cut."""
        orders: list[list[str]] = []
        for what in self._seen or []:
            if what == BEFORE:
                orders.append([])
            elif orders:
                orders[-1].append(what)
        return dict(Counter(" ".join(order) for order in orders[:-1]))

    def _on_draw(self, _phase: int, _is_before: int, _refcon: object) -> int:
        self.note(DRAW)
        return 1
