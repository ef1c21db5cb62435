"""``xplane-bridge/datarefs.csv`` lists exactly the datarefs and commands of X-Plane that the client or the plugin uses, each with the
versions of X-Plane in which it is touched, and with its successor where X-Plane 12 has replaced it."""

import paths

import csv
import re
import unittest

BRIDGE = paths.PLUGIN.parent
TABLE = BRIDGE / "datarefs.csv"
NO_SUCCESSOR = "no successor that can be written"
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


def rows():
    """The rows of the table, checked: names once, known versions, successors that are in the table."""
    with TABLE.open(encoding="utf-8", newline="") as table:
        found = list(csv.DictReader(table))
    names = [row["name"] for row in found]
    assert len(names) == len(set(names)), f"twice: {sorted(name for name in names if names.count(name) > 1)}"
    for row in found:
        assert row["meaning"] and row["source"], f"an empty cell: {row}"
        assert row["versions"] in ("11", "12", "11 12"), f"which version: {row}"
        successor = row["successor_in_12"]
        if row["versions"] == "11":
            assert successor in names or successor.startswith("none"), f"which successor: {row}"
        else:
            assert successor in ("", NO_SUCCESSOR), f"no successor expected: {row}"
    return found


def documented(version=None):
    """The names of the table, or those that are touched in a version of X-Plane: ``"11"`` or ``"12"``."""
    return {row["name"] for row in rows() if version is None or version in row["versions"].split()}


class Documented(unittest.TestCase):
    def test_the_table_has_every_name_that_is_used_and_no_other(self):
        self.assertEqual(sorted(used() - documented()), [], "used, but not in datarefs.csv")
        self.assertEqual(sorted(documented() - used()), [], "in datarefs.csv, but not used")

    def test_the_plugin_touches_each_name_in_the_versions_that_the_table_says(self):
        from dtd_bridge import datarefs

        eleven, twelve = documented("11"), documented("12")
        mine = {value for value in vars(datarefs).values() if isinstance(value, str)} | {
            name for value in vars(datarefs).values() if isinstance(value, tuple) for name in value if isinstance(name, str)
        }
        for name in sorted(name for name in mine if name.startswith("sim/") and not name.endswith("/")):
            plain = name.split("[")[0]
            wanted = (name not in datarefs.ONLY_12, name not in datarefs.ONLY_11)
            self.assertEqual((plain in eleven, plain in twelve), wanted, name)

    def test_what_12_has_no_successor_for_is_named_with_that_reason(self):
        from dtd_bridge import datarefs

        named = {row["name"] for row in rows() if row["successor_in_12"] == NO_SUCCESSOR}
        self.assertEqual(named, set(datarefs.WITHOUT_SUCCESSOR))

    def test_the_client_names_those_of_one_version_as_the_table_does(self):
        """By the comments of its constants, which begin with the version."""
        text = (BRIDGE / "src" / "datarefs.rs").read_text(encoding="utf-8").split("mod tests")[0]
        eleven, twelve = documented("11"), documented("12")
        found = re.findall(r'/// (X-Plane (1[12])[^\n]*)\n(?:///[^\n]*\n)*pub (?:\(crate\) )?const \w+: &str =\s+"(sim/[^"\[]+)', text)
        self.assertGreater(len(found), 40)
        for _, version, name in found:
            self.assertEqual((name in eleven, name in twelve), (version == "11", version == "12"), name)


if __name__ == "__main__":
    unittest.main()
