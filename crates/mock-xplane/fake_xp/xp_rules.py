"""From where a plugin may call ``xp``: what X-Plane 12.4 checks, and what others saw to hang or crash it.

A loop after the flight model may only patch values. Whatever creates, takes planes, counts aircraft or runs commands has to come from a
loop before it. While X-Plane disables a plugin there is no frame any more.
"""

from __future__ import annotations

# The callbacks of a plugin, by the place from which X-Plane makes them.
START, ENABLE, DISABLE, STOP, MESSAGE = "start", "enable", "disable", "stop", "message"
BEFORE, AFTER, CAMERA, DRAW, ACCESSOR = "before", "after", "camera", "draw", "accessor"

# Functions that may be called from some places only; the others may be called from all.
PLACES: dict[str, frozenset[str]] = {
    "createFlightLoop": frozenset({ENABLE}),
    "destroyFlightLoop": frozenset({ENABLE, DISABLE}),
    "scheduleFlightLoop": frozenset({ENABLE, BEFORE}),
    "registerDataAccessor": frozenset({START}),
    "unregisterDataAccessor": frozenset({STOP}),
    **dict.fromkeys(("createProbe", "destroyProbe", "probeTerrainXYZ"), frozenset({BEFORE})),
    **dict.fromkeys(("countAircraft", "acquirePlanes", "releasePlanes", "setActiveAircraftCount"), frozenset({BEFORE})),
    **dict.fromkeys(("commandOnce", "placeUserAtLocation", "controlCamera", "registerDrawCallback"), frozenset({BEFORE})),
    **dict.fromkeys(("dontControlCamera", "unregisterDrawCallback"), frozenset({BEFORE, DISABLE})),
    "set": frozenset({BEFORE, AFTER, CAMERA, DISABLE}),
    "setGraphicsState": frozenset({DRAW}),
}
