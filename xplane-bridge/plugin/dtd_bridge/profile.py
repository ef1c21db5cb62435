"""The results of ``dtd doctor`` for this X-Plane, stored next to the plugin: for clients on any computer.

Clients store it and receive it with every ``hello``; only clients interpret it, except for what the plugin itself uses.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from .messages import LastingRefusal, Refusal
from .wire import check_sound, encode

Profile = dict[str, Any]

# Largest profile as it is sent. A hello contains it, so a larger one could make every hello too long to be sent.
MAX_PROFILE_BYTES = 16 << 10
# The file is indented, and its text may be escaped.
MAX_FILE_BYTES = 16 * MAX_PROFILE_BYTES


class ProfileFile:
    """The file, if there is one."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def read(self) -> Profile | None:
        """The stored profile; empty if there is no file, or an invalid one."""
        try:
            return self._read()
        except (OSError, ValueError, RecursionError):
            return None

    def drop_if_unusable(self) -> str | None:
        """Removes a file that no hello could contain, and returns why; `None` if it is usable or missing. One that cannot be read now
        stays: its content may be sound."""
        try:
            self._read()
        except FileNotFoundError:
            pass
        except (OSError, ValueError, RecursionError) as error:
            reason = f"the profile in {self._path} is not used: {error}"
            if isinstance(error, OSError):
                return f"{reason}. It stays there"
            try:
                self._path.unlink()
            except OSError as stays:
                return f"{reason}. It cannot be removed: {stays}"
            return f"{reason}. It was removed; `dtd doctor` measures it again"
        return None

    def _read(self) -> Profile:
        """Raises ValueError for what is not a profile."""
        with self._path.open("rb") as file:
            text = file.read(MAX_FILE_BYTES + 1)
        if len(text) > MAX_FILE_BYTES:
            raise ValueError(f"it has more than {MAX_FILE_BYTES} bytes")
        found = json.loads(text)
        if not isinstance(found, dict):
            raise ValueError("it is not an object")
        _check(found)
        return found

    def keep(self, profile: Profile) -> None:
        """Replaces it, atomically."""
        fresh = self._path.with_suffix(".new")
        try:
            fresh.write_text(json.dumps(profile, indent=2) + "\n", encoding="utf-8")
            os.replace(fresh, self._path)
        except OSError as error:
            raise Refusal(f"cannot keep the profile in {self._path}: {error}. Make the plugin's folder writable") from error


def refuse_unsound(profile: Profile) -> None:
    """Refuses to keep a profile that no hello could contain."""
    try:
        _check(profile)
    except ValueError as error:
        raise LastingRefusal(f"the profile is not kept: {error}") from error


def _check(profile: Profile) -> None:
    """Raises ValueError for a profile that no hello could contain."""
    check_sound(profile)
    length = len(encode(profile))
    if length > MAX_PROFILE_BYTES:
        raise ValueError(f"it has {length} bytes, expected at most {MAX_PROFILE_BYTES}")


def still_pictures_move(profile: Profile | None) -> bool:
    """Whether images were seen to move by themselves in a pause, so that waiting for two equal ones is pointless."""
    found = (profile or {}).get("still_pictures_move")
    return isinstance(found, dict) and found.get("found") is True
