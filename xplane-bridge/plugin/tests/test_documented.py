"""The table of ``docs/x-plane.md`` lists exactly the datarefs and commands of X-Plane that the client or the plugin uses."""

import paths

import re
import unittest

BRIDGE = paths.PLUGIN.parent
TABLE = BRIDGE.parent / "docs" / "x-plane.md"
NAME = re.compile(r"sim/[a-zA-Z0-9_/]+")


def used():
    """Names in the sources, and those that the plugin composes."""
    sources = [BRIDGE / "src" / "datarefs.rs", *(BRIDGE / "src" / "datarefs").glob("*.rs")]
    sources += (BRIDGE / "src" / "simulator" / "doctor").glob("*.rs")
    sources += (paths.PLUGIN / "dtd_bridge").glob("*.py")
    found = set()
    for source in sources:
        text = source.read_text(encoding="utf-8").split("mod tests")[0]
        found |= {match.rstrip("/") for literal in re.findall(r'"(sim/[^"{]+)"', text) for match in NAME.findall(literal)}
    from dtd_bridge import datarefs, stage

    for module in (datarefs, stage):
        for value in vars(module).values():
            for name in value if isinstance(value, tuple) else (value,):
                if isinstance(name, str) and name.startswith("sim/"):
                    found |= {NAME.match(name).group().rstrip("/")}
    # Beginnings of names.
    return found - {"sim/flightmodel/position", "sim/graphics/view", "sim/weather", "sim/weather/region", "sim/time", "sim/autopilot"}


def documented():
    rows = [line for line in TABLE.read_text(encoding="utf-8").splitlines() if line.startswith("| `sim/")]
    names = [name for row in rows for name in NAME.findall(row.split("|")[1])]
    assert len(names) == len(set(names)), f"twice: {sorted(name for name in names if names.count(name) > 1)}"
    for row in rows:
        assert all(cell.strip() for cell in row.strip().strip("|").split("|")), f"an empty cell: {row}"
    return set(names)


class Documented(unittest.TestCase):
    def test_the_table_has_every_name_that_is_used_and_no_other(self):
        self.assertEqual(sorted(used() - documented()), [], "used, but not in docs/x-plane.md")
        self.assertEqual(sorted(documented() - used()), [], "in docs/x-plane.md, but not used")


if __name__ == "__main__":
    unittest.main()
