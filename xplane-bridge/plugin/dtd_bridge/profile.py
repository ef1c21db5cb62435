"""The results of ``dtd doctor`` for this X-Plane, stored next to the plugin: for clients on any computer.

Clients store it and receive it with every ``hello``; only clients interpret it, except for what the plugin itself uses.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from .messages import Refusal

Profile = dict[str, Any]


class ProfileFile:
    """The file, if there is one."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def read(self) -> Profile | None:
        """The stored profile; empty if there is no file, or an invalid one."""
        try:
            found = json.loads(self._path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return found if isinstance(found, dict) else None

    def keep(self, profile: Profile) -> None:
        """Replaces it, atomically."""
        fresh = self._path.with_suffix(".new")
        try:
            fresh.write_text(json.dumps(profile, indent=2) + "\n", encoding="utf-8")
            os.replace(fresh, self._path)
        except OSError as error:
            raise Refusal(f"cannot keep the profile in {self._path}: {error}. Make the plugin's folder writable") from error


def still_pictures_move(profile: Profile | None) -> bool:
    """Whether pictures were seen to move by themselves in a pause, so that waiting for two equal ones is pointless."""
    found = (profile or {}).get("still_pictures_move")
    return isinstance(found, dict) and found.get("found") is True
