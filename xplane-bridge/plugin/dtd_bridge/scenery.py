"""Waiting for the ground to load, and its height.

X-Plane has a flag for loading scenery, but clears it before the fine ground has loaded: the ground is ready when its height is
stable.
"""

from __future__ import annotations

import time
from typing import Callable, Generator

from .messages import Refusal
from .stage import Stage
from .xp_api import Xp

# However early it seems ready: after a jump the loading flag is set with a delay.
HOLD_S = 3.0
LIMIT_S = 60.0
# Number of probes of the ground, their interval, and how closely they must agree.
PROBES, PROBE_GAP_S, PROBES_WITHIN_M = 4, 0.5, 1.0


class Ground:
    """The height of the ground that X-Plane shows."""

    def __init__(self, xp: Xp) -> None:
        self._xp = xp

    def height_msl_m(self, latitude: float, longitude: float) -> float | None:
        """At a place; ``None`` where none is loaded. The probe lives only that long: none is left to be destroyed when X-Plane
        disables the plugin."""
        xp = self._xp
        probe = xp.createProbe(xp.ProbeY)
        try:
            altitude = 0.0
            # A probe goes along the local y axis, which leans away from the vertical with distance from the local origin: the second
            # look starts where the first one landed and hits below the place itself.
            for _ in range(2):
                hit = xp.probeTerrainXYZ(probe, *xp.worldToLocal(latitude, longitude, altitude))
                if hit.result != xp.ProbeHitTerrain:
                    return None
                _, _, altitude = xp.localToWorld(hit.locationX, hit.locationY, hit.locationZ)
            return altitude
        finally:
            xp.destroyProbe(probe)


def wait(
    stage: Stage, ground: Ground, place: tuple[float, float], each_frame: Callable[[], None]
) -> Generator[None, None, None]:
    """Until the scenery around a place has loaded. ``each_frame`` holds the aircraft there: the jump moves X-Plane's local
    origin."""
    began = time.monotonic()
    heights: list[float] = []
    probed_at = began - PROBE_GAP_S
    while True:
        each_frame()
        now = time.monotonic()
        if stage.scenery_is_loading():
            heights.clear()
        elif now - probed_at >= PROBE_GAP_S:
            probed_at = now
            height = ground.height_msl_m(*place)
            heights = [] if height is None else [*heights, height][-PROBES:]
            agree = len(heights) == PROBES and max(heights) - min(heights) <= PROBES_WITHIN_M
            if agree and now - began >= HOLD_S:
                return
        if now - began > LIMIT_S:
            what = "it still loads" if stage.scenery_is_loading() else f"the ground's height is still {heights or 'not there'}"
            raise Refusal(
                f"the scenery at latitude {place[0]:.4f}, longitude {place[1]:.4f} has not come within {LIMIT_S:.0f} s: {what}. Is it "
                "installed? Lower the graphics settings if it loads slowly"
            )
        yield
