"""Writes the tables in docs/results.md from the JSON files beside it, each between its markers `<!-- NAME.json -->` and `<!-- end -->`.

Usage: result_tables.py [--check]; with --check nothing is written, and a table that differs is an error. A table that an older version of
the program measured gets a remark.
"""

import json
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs/results.md"
# Where the sources count the versions of what they write.
VERSIONS = {
    "run": ("trainer/src/run/trained.rs", "RUN_FORMAT"),
    "health": ("labeller/src/view_health.rs", "METHOD"),
    "registration": ("labeller/src/registration.rs", "METHOD"),
    "tracking": ("labeller/src/tracking.rs", "METHOD"),
}
SHOWN = {
    "exchanged": "exchanged with the left one",
    "one-twice": "shows the left one's images",
    "both-yaw-2px": "both, yaw 2 px",
    "opposite-yaw-2px": "both, yaw 2 px in opposite senses",
    "drift": "yaw of 0.1 degrees in 5 minutes",
    "late-1s-after-2min": "late by 1 s after 2 min",
}


def versions():
    """Versions of the program in this folder."""
    found = {}
    for name, (path, constant) in VERSIONS.items():
        match = re.search(rf"const {constant}: u32 = (\d+);", (ROOT / path).read_text())
        if match is None:
            sys.exit(f"{path} has no constant {constant}; correct VERSIONS in scripts/result_tables.py")
        found[name] = int(match[1])
    return found


def name_of(row):
    """A row of moved_cameras.py in words."""
    if row in SHOWN:
        return SHOWN[row]
    kind, _, size = row.partition("-")
    if kind in ("yaw", "pitch"):
        return f"{kind} {size.removesuffix('px')} px"
    if kind == "late":
        return f"late by {size.removesuffix('s')} s"
    return f"focal length {row.removeprefix('focal')} %" if row.startswith("focal") else row


def older_parts(row, now):
    """Parts of the program that have another version since a row was measured."""
    return {name for name, number in now.items() if row["versions"].get(name) != number}


def cameras(measured, now):
    """The table of cameras.json."""
    lines = [
        "| right camera | flights | filter: MAPE, % | worst flight | 90 % intervals hold | worst flight | smoother | `self_calibrated` | answers |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    number = lambda value, digits: "none" if value is None else f"{value:.{digits}f}"
    percent = lambda share: "" if share is None else f"{100 * share:.0f} %"
    known = lambda by_flight: [value for value in by_flight.values() if value is not None]
    for row, of in measured["rows"].items():
        filtered, smoothed, calibrated = (of[name] for name in ("inverse_range_filtered", "inverse_range_smoothed", "self_calibrated"))
        errors, held = known(filtered["mape_pct_by_flight"]), known(filtered["held_90_by_flight"])
        cells = [
            name_of(row) + (" \\*" if older_parts(of, now) else ""),
            str(len(filtered["answered_by_flight"])),
            number(filtered["mape_pct"], 4),
            number(max(errors, default=None), 3),
            percent(filtered["held_90"]),
            percent(min(held, default=None)),
            number(smoothed["mape_pct"], 4),
            number(calibrated["mape_pct"], 4),
            percent(filtered["answered_of_untouched"]),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def remark(measured, now):
    """Line for a table of an older version; none otherwise."""
    older = set().union(*(older_parts(row, now) for row in measured["rows"].values()))
    if not older:
        return []
    return ["", f"\\* By an earlier version of the program ({', '.join(sorted(older))}); to be measured again."]


def main():
    page, now = PAGE.read_text(), versions()
    for name, table in {"cameras": cameras}.items():
        measured = json.loads((ROOT / f"docs/results/{name}.json").read_text())
        lines = [f"<!-- {name}.json -->", *table(measured, now), *remark(measured, now), "<!-- end -->"]
        page, count = re.subn(rf"<!-- {name}\.json -->\n.*?<!-- end -->", lambda _, lines=lines: "\n".join(lines), page, flags=re.DOTALL)
        if count != 1:
            sys.exit(f"docs/results.md has {count} places for the table of {name}.json, expected 1: `<!-- {name}.json -->` to `<!-- end -->`")
    if page == PAGE.read_text():
        return
    if "--check" in sys.argv[1:]:
        sys.exit("tables in docs/results.md differ from docs/results/*.json: run scripts/result_tables.py")
    PAGE.write_text(page)


if __name__ == "__main__":
    main()
