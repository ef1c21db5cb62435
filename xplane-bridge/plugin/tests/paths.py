"""Puts the plugin and the fake ``xp`` on the path; imported first by every test."""

import sys
from pathlib import Path

PLUGIN = Path(__file__).resolve().parents[1]
GOLDEN = PLUGIN.parent / "golden"
FAKE_XP = PLUGIN.parents[1] / "crates" / "mock-xplane" / "fake_xp"

for folder in (PLUGIN, FAKE_XP):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
sys.dont_write_bytecode = True
