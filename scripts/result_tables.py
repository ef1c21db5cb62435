"""Writes the tables in docs/results.md from the JSON files beside it, each between its markers `<!-- NAME.json: TABLE -->` and
`<!-- end -->`.

Usage: result_tables.py [--check]; with --check nothing is written, and a table that differs is an error. A table that an older version of
the program measured gets a remark.
"""

import json
import math
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
    "blur-0-3px": "both blurred by 0 to 3 px",
    "sway-2px": "both on masts that sway by 2 px",
    "yaw-2deg": "yaw 2 degrees",
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


def older_parts(measured, now):
    """Parts of the program that have another version since something was measured; all of them if it has no versions."""
    versions = measured.get("versions", {})
    return {name for name, number in now.items() if versions.get(name) != number}


def remark(*measured, now, mark=""):
    """Line about what an older version measured, if anything was. `mark`: stands beside its rows."""
    older = sorted(set().union(*(older_parts(of, now) for of in measured)))
    return ["", f"{mark}By an earlier version of the program ({', '.join(older)}); to be measured again."] if older else []


def number(value, digits):
    return "none" if value is None else f"{value:.{digits}f}"


def percent(share, digits=0):
    return "" if share is None else f"{100 * share:.{digits}f} %"


def rounded(value):
    """An error in percent, to three significant digits and no finer than 0.0001."""
    if value is None:
        return "none"
    return f"{value:.{max(2 - math.floor(math.log10(value)), 0) if value >= 0.01 else 4}f}"


def as_table(head, rows):
    return [f"| {' | '.join(head)} |", "|---" * len(head) + "|", *(f"| {' | '.join(cells)} |" for cells in rows)]


def cameras(measured, now):
    """Cameras that stand a little off, by fault."""
    known = lambda by_flight: [value for value in by_flight.values() if value is not None]
    rows = []
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
        rows.append(cells)
    of_filter = ["filter: MAPE, %", "worst flight", "90 % intervals hold", "worst flight"]
    head = ["right camera", "flights", *of_filter, "smoother", "`self_calibrated`", "answers"]
    return [*as_table(head, rows), *remark(*measured["rows"].values(), now=now, mark="\\* ")]


ABOUT = {
    "inverse_range_smoothed": "offline",
    "inverse_range_filtered": "causal",
    "inverse_range": "tick by tick",
    "self_calibrated": "needs both views",
    "triangulation": "the oracle: true cameras",
    "mono_network": "size only",
}
REMOVED = {"random_15_pct": "15 % of ticks with one view", "bursts_5_s": "bursts of 5 s", "bursts_20_s": "20 s", "bursts_60_s": "60 s"}


def estimators(measured, now):
    """Every estimator that `evaluate` judged, the most accurate first."""
    judged = {name: of for name, of in measured["estimators"].items() if of["mape_pct"] is not None}
    rows = []
    for name, of in sorted(judged.items(), key=lambda item: item[1]["mape_pct"]):
        needs_both = of["views_removed"]["random_15_pct"]["coverage"] < 0.99 * of["coverage"]
        removed = []
        for kind in REMOVED:
            without = of["views_removed"][kind]
            removed.append(rounded(without["mape_pct"]) + (f" at {percent(without['coverage'])}" if needs_both else ""))
        about = f" ({ABOUT[name]})" if name in ABOUT else ""
        errors = [rounded(of[key]) for key in ("mape_pct", "median_pct", "p95_pct")]
        rows.append([f"`{name}`{about}", *errors, percent(of["coverage"], 1), rounded(of["dual"]["mape_pct"]), *removed])
    head = ["estimator", "MAPE, %", "median", "95 % below", "coverage", "two views", *REMOVED.values()]
    return [*as_table(head, rows), *remark(measured, now=now)]


def conditions(measured, now):
    """The filter by weather and local time."""
    of = measured["estimators"]["inverse_range_filtered"]
    there = {**of["by_weather"], **of["by_time"]}
    rows = [
        ["MAPE, %", *(rounded(one["mape_pct"]) for one in there.values())],
        ["coverage", *(percent(one["coverage"], 1) for one in there.values())],
    ]
    return [*as_table(["", *there], rows), *remark(measured, now=now)]


def left_out(measured, now):
    """The filter under conditions that the training left out."""
    of = lambda training: measured[training]["inverse_range_filtered"]
    names = ["weather=clear", "weather=cloudy", "weather=foggy", "weather=stormy", *(name for name in measured if name.startswith("time="))]
    condition = lambda name: name.split("=")[1]
    with_all = {**of("nothing")["by_weather"], **of("nothing")["by_time"]}
    rows = [
        ["MAPE there, trained with all, %", rounded(of("nothing")["mape_pct"]), *(rounded(with_all[condition(name)]) for name in names)],
        ["left out, %", "", *(rounded(of(name)["mape_pct"]) for name in names)],
        ["90 % intervals hold, left out", "", *(percent(of(name)["intervals_held"]) for name in names)],
    ]
    head = ["`inverse_range_filtered`", "all", *(condition(name) for name in names)]
    return [*as_table(head, rows), *remark(*measured.values(), now=now)]


NOT_IDEAL = {
    "untouched": "untouched",
    "still": "still false boxes in one view",
    "moving": "moving ones",
    "one-view-arrival": "a second arrival in one view",
    "step-down": "profile `step-down`",
    "continuous-descent": "profile `continuous`, which the training does not have",
    "late-490ms": "right view 0.49 s late",
    "late-450ms": "right view 0.45 s late",
    "late-200ms": "right view 0.2 s late",
    "shake-2px": "right view shaking by 2 px",
    "turned-0.3deg": "right view turned by 0.3 degrees in mid flight",
    "frozen-4pct": "4 % of the right view's images frozen",
    "tilt-2arcsec": 'air that tilts images by 2" at 10 km',
    "trained-tilt-2arcsec": "trained with that",
    "tilt-5arcsec": 'air that tilts images by 5" at 10 km',
    "trained-tilt-5arcsec": "trained with that",
    "tower-camera": "preset `tower-camera`",
    "trained-tower-camera": "trained with that",
    "replaced": "false boxes in place of the aircraft's in one view",
    "missing": "no boxes in one view",
    "arrival-behind": "second arrival a minute behind",
    "arrival-ahead": "second arrival a minute ahead",
}


def not_ideal(measured, now):
    """Flights in a world that is not ideal, by fault; faults with the same figures in one row."""
    names = {}
    for row, name in NOT_IDEAL.items():
        of = [measured["rows"][row][estimator] for estimator in ("inverse_range", "inverse_range_filtered", "inverse_range_smoothed")]
        errors = [rounded(one.get("of_either_aircraft_mape_pct", one["mape_pct"])) for one in of]
        held = [percent(one["intervals_90"]["held"]) if "intervals_90" in one else "" for one in of[1:]]
        names.setdefault((*errors, *held, percent(of[1]["coverage"])), []).append(name)
    head = ["", "MAPE tick by tick, %", "filter", "smoother", "90 % intervals hold: filter", "smoother", "coverage"]
    rows = [["; ".join(of), *cells] for cells, of in names.items()]
    return [*as_table(head, rows), *remark(*(measured["rows"][row] for row in NOT_IDEAL), now=now)]


WRONG_VIEWS = {
    "untouched": "untouched",
    "exchanged": "left and right exchanged",
    "right mirrored": "right mirrored",
    "both mirrored and exchanged": "both mirrored and exchanged",
    "left twice": "left twice",
    "two flights": "right from a different flight, 50 to 150 m away",
    "a third of the ground changed": "a third of the right one's ground changed",
}


def wrong_views(measured, now):
    """Live answers from views that do not belong to the run or to each other, by light and fog."""
    flights = lambda kind, is_foggy: {id: of for id, of in measured[kind]["by_flight"].items() if ("foggy" in id) == is_foggy}
    rows = []
    for kind, name in WRONG_VIEWS.items():
        if kind not in measured:
            continue
        for is_foggy in (False, True):
            of, usual = flights(kind, is_foggy), flights("untouched", is_foggy)
            cells = [f"{name}, in fog" if is_foggy else name, str(len(of))]
            of_usual = sum(one["with_2"]["answers"] for one in usual.values())
            for count in ("with_2", "with_1"):
                answers = sum(one[count]["answers"] for one in of.values())
                answered = [one[count] for one in of.values() if one[count]["answers"]]
                held = sum(one["answers"] * one["held_90"] for one in answered) / answers if answers else None
                worst = max((one["worst_pct"] for one in answered), default=None)
                cells += [percent(answers / of_usual), rounded(worst) if answers else "", percent(held)]
            named = [one["named_s"] for one in of.values()]
            after = [max(named_s - usual[id]["first_answer_s"], 0) for id, named_s in zip(of, named) if named_s is not None]
            cells.append(f"{len(after)} of {len(of)}" + (f", within {max(after):.0f} s" if after else ""))
            rows.append(cells)
    of_views = ["worst, %", "intervals hold"]
    head = ["sources", "flights", "answers from both views", *of_views, "from one view", *of_views, "named"]
    return [*as_table(head, rows), *remark(*measured.values(), now=now)]


TABLES = {
    "metrics.json: estimators": estimators,
    "metrics.json: conditions": conditions,
    "not-ideal.json: faults": not_ideal,
    "left-out.json: conditions": left_out,
    "cameras.json: faults": cameras,
    "wrong-views.json: sources": wrong_views,
}


def main():
    page, now = PAGE.read_text(), versions()
    for marker, table in TABLES.items():
        measured = json.loads((ROOT / "docs/results" / marker.partition(":")[0]).read_text())
        lines = [f"<!-- {marker} -->", *table(measured, now), "<!-- end -->"]
        pattern = rf"<!-- {re.escape(marker)} -->\n.*?<!-- end -->"
        page, count = re.subn(pattern, lambda _, lines=lines: "\n".join(lines), page, flags=re.DOTALL)
        if count != 1:
            sys.exit(f"docs/results.md has {count} places for a table, expected 1: `<!-- {marker} -->` to `<!-- end -->`")
    if page == PAGE.read_text():
        return
    if "--check" in sys.argv[1:]:
        sys.exit("tables in docs/results.md differ from docs/results/*.json: run scripts/result_tables.py")
    PAGE.write_text(page)


if __name__ == "__main__":
    main()
