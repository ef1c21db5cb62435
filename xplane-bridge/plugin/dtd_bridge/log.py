"""Lines for XPPython3's log, and faults of callbacks.

XPPython3 does not flush its log by default, so lines would appear late and be lost in a crash: each one is flushed. A fault in a
callback would repeat with every frame: it is logged once. What clients do is logged once a minute and source: any program could
otherwise fill the disk.
"""

from __future__ import annotations

import time
import traceback

from . import NAME
from .xp_api import Xp

# Shortest time between two lines of a kind about clients of one address.
LINE_PERIOD_S = 60.0
# Sources that are remembered.
MAX_SOURCES = 256


def log(xp: Xp, text: str) -> None:
    """Writes a line and flushes it: XPPython3 flushes at an empty text."""
    xp.log(text)
    xp.log("")


class ClientLines:
    """Lines about what clients did, at most one a minute for each kind of event and source."""

    def __init__(self, xp: Xp) -> None:
        self._xp = xp
        # By kind and source: when a line was written, and how many were not since then.
        self._written: dict[tuple[str, str], tuple[float, int]] = {}

    def say(self, kind: str, source: str, text: str) -> None:
        """Writes the line, or counts it."""
        now = time.monotonic()
        written_at, unwritten = self._written.get((kind, source), (now - LINE_PERIOD_S, 0))
        if now - written_at < LINE_PERIOD_S:
            self._written[kind, source] = (written_at, unwritten + 1)
            return
        if len(self._written) >= MAX_SOURCES:
            self._written.clear()
        self._written[kind, source] = (now, 0)
        log(self._xp, f"{text} ({unwritten} more of these in the last {now - written_at:.0f} s)" if unwritten else text)


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
