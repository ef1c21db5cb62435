"""X-Plane's complaints about this plugin, from its own log.

X-Plane 12 writes a line into ``Log.txt`` when a plugin looks up a deprecated dataref or calls a function from where it must not. It knows
only the plugin XPPython3, which runs all plugins in Python: a complaint about a dataref is ours if we use that dataref.
"""

from __future__ import annotations

import re
from typing import Iterable

from . import NAME
from . import datarefs as names

# The most that a client is told.
MAX_LINES, MAX_CHARACTERS = 20, 300
_OURS = re.compile(rf"{re.escape(NAME)}|dtd[ ._]bridge", re.IGNORECASE)
_RUNS_US = re.compile(r"XPPython3", re.IGNORECASE)
_ABOUT_DATAREF = re.compile(r"Dataref '([^']+)' (?:has been replaced|is deprecated)")
_ABOUT_CALL = re.compile(r"The plugin .* called the SDK function")
_IS_ERROR = re.compile(r"\b[EW]/[A-Z]{3}\b|\berror\b", re.IGNORECASE)


def among(lines: Iterable[str]) -> list[str]:
    """The complaints in X-Plane's log, each once."""
    found = dict.fromkeys(line.strip()[:MAX_CHARACTERS] for line in lines if is_about_us(line))
    return list(found)[:MAX_LINES]


def is_about_us(line: str) -> bool:
    """Whether a line of X-Plane's log complains about this plugin."""
    if _OURS.search(line):
        return bool(_ABOUT_DATAREF.search(line) or _ABOUT_CALL.search(line) or _IS_ERROR.search(line))
    if not _RUNS_US.search(line):
        return False
    dataref = _ABOUT_DATAREF.search(line)
    if dataref:
        return dataref.group(1).split("[")[0] in _used()
    return bool(_ABOUT_CALL.search(line))


def _used() -> set[str]:
    """The datarefs of this plugin, without indices."""
    values = [value for value in vars(names).values() if isinstance(value, (str, tuple))]
    flat = [name for value in values for name in ((value,) if isinstance(value, str) else value) if isinstance(name, str)]
    return {name.split("[")[0] for name in flat}
