"""Lines for XPPython3's log, and faults of callbacks.

XPPython3 does not flush its log by default, so lines would appear late and be lost in a crash: each one is flushed. A fault in a
callback would repeat with every frame: it is logged once.
"""

from __future__ import annotations

import traceback

from . import NAME
from .xp_api import Xp


def log(xp: Xp, text: str) -> None:
    """Writes a line and flushes it: XPPython3 flushes at an empty text."""
    xp.log(text)
    xp.log("")


class Faults:
    """Exceptions that were caught in callbacks, since none may escape into X-Plane."""

    def __init__(self, xp: Xp) -> None:
        self._xp = xp
        # How often each one occurred.
        self._counts: dict[str, int] = {}

    def caught(self, where: str, error: Exception) -> None:
        """Counts the exception that is being handled, and logs it with its traceback the first time."""
        what = f"{where}: {error!r}"
        self._counts[what] = self._counts.get(what, 0) + 1
        if self._counts[what] == 1:
            log(self._xp, f"{NAME} failed in {what}. It goes on, and does not log this again:\n{traceback.format_exc()}")

    def summarize(self) -> None:
        """Logs how often those occurred that did so repeatedly, and starts anew."""
        for what, count in self._counts.items():
            if count > 1:
                log(self._xp, f"{NAME} failed {count} times in {what}")
        self._counts.clear()
