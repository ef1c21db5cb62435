"""The settings file next to the plugin, ``dtd_bridge.ini``. Without it, the defaults.

::

    [link]
    bind = 127.0.0.1     ; another address opens the link to other machines and wants a token
    port = 49010         ; 0 takes any free one; clients find it in the dataref dtd/bridge/capture_port
    token =              ; a secret; clients give it in the environment variable DTD_LINK_TOKEN
    grab = off           ; on gives images of this computer's screen, all of it, to clients on other ones who know the token

    [weather]
    settle_s = 15        ; how long regenerated weather takes to show
"""

from __future__ import annotations

import configparser
import ipaddress
from dataclasses import dataclass
from pathlib import Path


class SettingsError(Exception):
    """What is wrong with the file."""


@dataclass(frozen=True)
class Settings:
    """Where to listen, and values that cannot be measured."""

    bind: str = "127.0.0.1"
    port: int = 49010
    token: str | None = None
    weather_settle_s: float = 15.0
    grab: bool = False

    def __post_init__(self) -> None:
        """Anyone who reaches the link controls the simulator: a link that others can reach needs a secret, and an empty one does
        not count."""
        if not ipaddress.ip_address(self.bind).is_loopback and not (self.token or "").strip():
            raise SettingsError(f"bind = {self.bind} opens the link to other machines: give a token as well")
        if self.grab and not (self.token or "").strip():
            raise SettingsError("grab = on shows this computer's screen to whoever reaches the link: give a token as well")


KNOWN = {"link": {"bind", "port", "token", "grab"}, "weather": {"settle_s"}}


def read_settings(path: Path) -> Settings:
    """Reads the file if it exists. Unknown keys are rejected: a mistyped token must not open the link."""
    if not path.exists():
        return Settings()
    parser = configparser.ConfigParser(inline_comment_prefixes=(";",), interpolation=None)
    try:
        parser.read_string(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, configparser.Error) as error:
        raise SettingsError(f"{path}: {error}") from error
    for section in parser.sections():
        for key in parser[section]:
            if key not in KNOWN.get(section, ()):
                raise SettingsError(f"{path}: unknown key {key} in [{section}], known are {KNOWN}")
    try:
        settings = Settings(
            bind=parser.get("link", "bind", fallback=Settings.bind),
            port=parser.getint("link", "port", fallback=Settings.port),
            token=parser.get("link", "token", fallback="") or None,
            weather_settle_s=parser.getfloat("weather", "settle_s", fallback=Settings.weather_settle_s),
            grab=parser.getboolean("link", "grab", fallback=Settings.grab),
        )
    except (ValueError, SettingsError) as error:
        raise SettingsError(f"{path}: {error}") from error
    if not 0 <= settings.port <= 65_535 or not 0 <= settings.weather_settle_s <= 60:
        raise SettingsError(f"{path}: port is 0 to 65535, settle_s 0 to 60")
    return settings
