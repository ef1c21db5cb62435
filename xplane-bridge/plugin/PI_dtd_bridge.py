"""dtd bridge: serves the capture link of `dtd` inside X-Plane 11 (XPPython3 3.1) and 12 (XPPython3 4).

Installed by ``dtd install-plugin``. The logic is in ``dtd_bridge``; this file only connects it to X-Plane. Errors are written to
XPPython3's log and sent to the client; nothing is raised into X-Plane.
"""

from __future__ import annotations

import sys
import traceback
from pathlib import Path
from typing import Any, Callable

try:
    import xp as module  # type: ignore[import-not-found]  # XPPython3 4, X-Plane 12
except ImportError:
    from XPPython3 import xp as module  # type: ignore[import-not-found]  # XPPython3 3, X-Plane 11

HERE = Path(__file__).resolve().parent
if str(HERE) not in sys.path:
    sys.path.insert(0, str(HERE))

from dtd_bridge import NAME, VERSION  # noqa: E402
from dtd_bridge import datarefs as names  # noqa: E402
from dtd_bridge.bridge import Bridge  # noqa: E402
from dtd_bridge.log import log  # noqa: E402
from dtd_bridge.profile import ProfileFile  # noqa: E402
from dtd_bridge.settings import read_settings  # noqa: E402
from dtd_bridge.xp_api import Xp  # noqa: E402

xp: Xp = module


def _publish(name: str, read: Callable[[], float]) -> Any:
    """Registers a dataref of a number, as an integer and as a float."""

    def read_int(_refcon: Any) -> int:
        return int(read())

    def read_float(_refcon: Any) -> float:
        return float(read())

    return xp.registerDataAccessor(
        name, dataType=xp.Type_Int | xp.Type_Float, writable=0, readInt=read_int, readFloat=read_float
    )


class PythonInterface:
    """The interface for XPPython3."""

    def __init__(self) -> None:
        self._bridge: Bridge | None = None
        self._settle_s = 0.0
        self._accessors: list[Any] = []

    def XPluginStart(self) -> tuple[str, str, str]:
        """X-Plane has loaded the plugin: name, signature, description."""
        try:
            for name, read in (
                (names.PUBLISHED_PORT, self._read_port),
                (names.PUBLISHED_WEATHER_SETTLE_S, self._read_settle_s),
            ):
                self._accessors.append(_publish(name, read))
        except Exception:
            self._log_failure("cannot publish its datarefs")
        return f"{NAME} {VERSION}", "dtd.bridge", "Serves poses and images to dtd over the capture link"

    def XPluginEnable(self) -> int:
        """Starts listening, and creates all flight loops. A plugin that cannot is still enabled: its log says why, and its port reads
        0."""
        try:
            settings = read_settings(HERE / "dtd_bridge.ini")
            self._settle_s = settings.weather_settle_s
            self._bridge = Bridge(xp, settings, profile=ProfileFile(HERE / "dtd_profile.json"))
        except Exception:
            self._log_failure("cannot serve the capture link")
        return 1

    def XPluginDisable(self) -> None:
        """Gives back what needs no frame."""
        bridge, self._bridge = self._bridge, None
        try:
            if bridge is not None:
                bridge.close()
        except Exception:
            self._log_failure("cannot stop cleanly")

    def XPluginStop(self) -> None:
        """X-Plane unloads the plugin."""
        try:
            while self._accessors:
                xp.unregisterDataAccessor(self._accessors.pop())
        except Exception:
            self._log_failure("cannot withdraw its datarefs")

    def XPluginReceiveMessage(self, _from_who: int, _message: int, _param: Any) -> None:
        """Nothing is needed: scenery loads are detected by their dataref, and no local coordinates are kept."""

    def _read_port(self) -> float:
        return self._bridge.port if self._bridge is not None else 0

    def _read_settle_s(self) -> float:
        return self._settle_s

    @staticmethod
    def _log_failure(what: str) -> None:
        log(xp, f"{NAME} {what}:\n{traceback.format_exc()}")
