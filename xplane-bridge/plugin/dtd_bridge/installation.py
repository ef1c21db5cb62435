"""Driver, graphics settings, scenery and exposure of this X-Plane, and the other plugins, which may draw as well.

X-Plane has no dataref for most of it. Its log names device, driver, desktop session and plugins; its preferences have a line for each
graphics setting, as last saved; ``scenery_packs.ini`` has the scenery. What stands nowhere is left out.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from . import complaints
from . import datarefs as names
from .datarefs import Datarefs
from .messages import Refusal
from .wire import Header

# X-Plane rewrites it at each start, and keeps it open.
LOG = "Log.txt"
PREFERENCES = "Output/preferences/X-Plane.prf"
SCENERY = "Custom Scenery/scenery_packs.ini"
# The beginning of a very long one.
MAX_BYTES = 32 << 20
# Limits of an answer, which is sent as one header.
MAX_ENTRIES, MAX_CHARACTERS = 150, 100
_OF_LOG = re.compile(r"^(Vulkan Device|Vulkan Driver|GLSL Version|Desktop session type)\s*: *(.+)$")
_PLUGIN = re.compile(r"Loaded: .+\.xpl \((.+)\)\.")
_OF_PREFERENCES = re.compile(r"^(renopt_\S+)\s+(.+)$")


def describe(system_path: str, datarefs: Datarefs, renderer: str | None) -> Header:
    """The answer to ``installation``. ``renderer`` draws for plugins, if one has drawn."""
    root = Path(system_path)
    log = _lines(root / LOG)
    if log is None:
        raise Refusal(f"X-Plane's log {root / LOG} cannot be read")
    settings = {"plugins' renderer": renderer} if renderer else {}
    for pattern, lines in ((_OF_LOG, log), (_OF_PREFERENCES, _lines(root / PREFERENCES) or [])):
        settings.update((match[1], match[2]) for line in lines if (match := pattern.match(line)))
    packs = [line for line in _lines(root / SCENERY) or [] if line.startswith("SCENERY_PACK ")]
    if packs:
        # Their order decides as well.
        digest = hashlib.sha256("\n".join(packs).encode()).hexdigest()[:16]
        settings["scenery packs"] = f"{len(packs)}, {digest}"
    plugins = dict.fromkeys(match.group(1) for line in log if (match := _PLUGIN.search(line)))
    return {
        "message": "installation",
        "complaints": complaints.among(log),
        "settings": {_cut(name): _cut(value) for name, value in list(settings.items())[:MAX_ENTRIES]},
        "plugins": [_cut(name) for name in list(plugins)[:MAX_ENTRIES]],
        **({"exposure_ev100": datarefs.get(names.EXPOSURE_EV100)} if datarefs.has(names.EXPOSURE_EV100) else {}),
    }


def _cut(text: str) -> str:
    return text.strip()[:MAX_CHARACTERS]


def _lines(path: Path) -> list[str] | None:
    try:
        with path.open("rb") as file:
            return file.read(MAX_BYTES).decode("utf-8", "replace").splitlines()
    except OSError:
        return None
