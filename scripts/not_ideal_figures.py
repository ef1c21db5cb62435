"""Figures of a row of not_ideal.py: errors and intervals by tick and by flight, what health noticed, what `dtd verify` found."""

import json
import re
from itertools import groupby

import numpy as np
import pyarrow.parquet as pq

NM = 1852.0
ESTIMATORS = ["inverse_range", "inverse_range_filtered", "inverse_range_smoothed", "self_calibrated"]
# Of a 90 % interval: what a miss costs for each part of the miss.
MISS = 2 / (1 - 0.9)
FACTORS = np.geomspace(0.25, 8, 121)
# A fault must be noticed after so many seconds and ticks.
SOON_S, SOON_TICKS = 5, 5
# What health should say, and the time at which the fault begins, seconds.
FAULTS = {"shake-2px": ("shaking", 0), "turned-0.3deg": ("moved", 120), "frozen-4pct": ("frozen", 0)}
LATE_MS = {"late-490ms": 490, "late-450ms": 450, "late-200ms": 200}
# How `dtd evaluate` names a view that is late.
LATE = r"(?P<flight>.*): view (?P<view>.*) is (?P<late_s>[0-9.]+) s late .*standard deviation (?P<sd_s>[0-9.]+) s.*"


def of_judged(folder, others=None):
    """Of a folder that `dtd evaluate` wrote. `others`: distances of a second aircraft, by scenario and tick; an answer may be about it."""
    metrics = json.loads((folder / "metrics.json").read_text())
    table = pq.read_table(folder / "predictions.parquet")
    flights = np.array(table["scenario"].to_pylist())
    number = lambda column: np.array(table[column].to_pylist(), dtype=float)
    dtd_m = number("dtd_m")
    judged = (dtd_m >= NM) & (dtd_m <= 10 * NM)
    two_views = np.array(table["detections"].to_pylist()) >= 2
    error_pct = {name: 100 * np.abs(number(f"{name}_dtd_m") / dtd_m - 1) for name in ESTIMATORS}
    if others is not None:
        ticks = table["tick"].to_pylist()
        other_m = np.array([others[flight].get(str(tick), np.nan) for flight, tick in zip(flights, ticks)])
        is_judged = (other_m >= NM) & (other_m <= 10 * NM)
        for name, of_ours in error_pct.items():
            of_other = 100 * np.abs(number(f"{name}_dtd_m") / other_m - 1)
            nearest = np.fmin(of_ours, of_other)
            error_pct[name] = np.where((of_other < of_ours) & ~is_judged, np.nan, nearest)
    row = {"ticks": metrics["ticks"], "disbelieved_boxes": metrics["disbelieved_boxes"]}
    row["dropped_training_boxes"] = metrics["dropped_training_boxes"]
    for name in ESTIMATORS:
        answered = judged & np.isfinite(error_pct[name])
        of = metrics["estimators"][name]
        row[name] = {
            **{key: of[key] for key in ("mape_pct", "median_pct", "p95_pct", "coverage", "coverage_in_sight")},
            "of_either_aircraft_mape_pct": float(error_pct[name][answered].mean()),
            "mape_pct_by_flight": by_flight(error_pct[name], answered, flights),
            "answered": {str(flight): int(answered[flights == flight].sum()) for flight in np.unique(flights)},
            "largest_pct": float(error_pct[name][answered].max(initial=0)),
            "above_1_pct": int((error_pct[name][answered] > 1).sum()),
            "above_1_pct_of_two_views": int((error_pct[name][answered & two_views] > 1).sum()),
        }
        if others is None:
            del row[name]["of_either_aircraft_mape_pct"]
        if others is not None or f"{name}_dtd_m_from" not in table.column_names:
            continue
        ends = np.array([number(f"{name}_dtd_m_{end}") for end in ("from", "to")])
        row[name]["intervals_90"] = intervals(number(f"{name}_dtd_m"), ends, dtd_m, answered, flights)
        row[name]["within_1_pct"] = within(ends, dtd_m, answered, error_pct[name])
        burst = of["views_removed"]["bursts_60_s"]["stated_intervals"]
        row[name]["intervals_90"]["bursts_60_s"] = {key: burst[key] for key in ("held", "held_by_flight")}
        common = answered & np.isfinite(error_pct["inverse_range"])
        pair = [error_pct[name], error_pct["inverse_range"]]
        row[name]["beside_single_ticks"] = beside(*pair, common, flights)
    return row


def by_flight(values, of, flights):
    """Mean of some values on each flight that has any."""
    return {str(flight): round(float(values[of & (flights == flight)].mean()), 4) for flight in np.unique(flights[of])}


def within(ends_m, dtd_m, answered, error_pct):
    """Answers whose interval is at most 2 % of the distance wide."""
    sure = answered & (ends_m[1] - ends_m[0] <= 0.02 * dtd_m)
    largest_pct = float(error_pct[sure].max(initial=0))
    return {"answered": int(sure.sum()), "largest_pct": largest_pct, "above_1_pct": int((error_pct[sure] > 1).sum())}


def intervals(answer_m, ends_m, dtd_m, answered, flights):
    """Shares that hold, and the interval score beside the one that the best factor of all widths would have."""
    of_flights = by_flight((ends_m[0] <= dtd_m) & (dtd_m <= ends_m[1]), answered, flights)
    answer_m, ends_m, dtd_m = answer_m[answered], ends_m[:, answered], dtd_m[answered]

    def score_pct(factor):
        low, high = answer_m + factor * (ends_m - answer_m)
        missed_m = np.maximum(low - dtd_m, 0) + np.maximum(dtd_m - high, 0)
        return float(np.mean(100 * (high - low + MISS * missed_m) / dtd_m))

    scores = [score_pct(factor) for factor in FACTORS]
    return {
        "held": float(np.mean(list(of_flights.values()))),
        "held_by_flight": of_flights,
        "score_pct": score_pct(1.0),
        "best_factor": float(FACTORS[np.argmin(scores)]),
        "score_by_best_factor": score_pct(1.0) / min(scores),
    }


def beside(error_pct, single_pct, common, flights):
    """MAPE of a filter relative to single ticks, where both answer; on each flight likewise."""
    if not common.any():
        return None
    ratios = {}
    worse = []
    for flight in np.unique(flights[common]):
        there = common & (flights == flight)
        mean, single = error_pct[there].mean(), single_pct[there].mean()
        ratios[str(flight)] = round(float(mean / single), 3)
        if mean > 1.15 * single and mean > single + 0.002:
            worse.append(str(flight))
    ratio = float(error_pct[common].mean() / single_pct[common].mean())
    return {"ratio": ratio, "largest_of_a_flight": max(ratios.values()), "flights_worse": worse, "flights": len(ratios)}


def scenarios(corpus):
    return sorted(folder for folder in (corpus / "scenarios").iterdir() if (folder / "health").is_dir())


def of_health(corpus, untouched, judged, row):
    """Affected images that were noticed, and false alarms of cameras without a fault. The right camera has the fault."""
    noticed = affected = alarms = 0
    seconds = 0.0
    named = (re.fullmatch(LATE, line) for line in json.loads((judged / "metrics.json").read_text()).get("late_views", []))
    lags = {late["flight", "view"]: [1e3 * float(number) for number in late["late_s", "sd_s"]] for late in named if late}
    for folder in scenarios(corpus):
        health = pq.read_table(next((folder / "health").glob("*.parquet"))).to_pylist()
        frames = pq.read_table(folder / "frames.parquet", columns=["tick", "time_ns"]).to_pylist()
        start_s = frames[0]["time_ns"] / 1e9
        time_s = {frame["tick"]: frame["time_ns"] / 1e9 - start_s for frame in frames}
        seen = boxes(untouched / "scenarios" / folder.name)
        repeated = repeats(folder, untouched / "scenarios" / folder.name) if row == "frozen-4pct" else set()
        for view in ("left", "right"):
            rows = [line for line in health if line["view"] == view]
            lag = lags.get((folder.name, view))
            is_late = lag is not None and (row not in LATE_MS or abs(lag[0] - LATE_MS[row]) <= 3 * lag[1])
            faulty = view == "right" and (row in FAULTS or row in LATE_MS)
            if not faulty and row != "tower-camera":
                seconds += time_s[rows[-1]["tick"]]
                alarms += alarms_of(rows) + is_late
            if not faulty:
                continue
            expected, begin_s = FAULTS.get(row, ("late", 0))
            begins = next(number for number, line in enumerate(rows) if time_s[line["tick"]] >= begin_s)
            for number, line in enumerate(rows):
                tick = line["tick"]
                since = (time_s[tick] - begin_s, number - begins)
                if expected == "frozen":
                    counts = tick in repeated
                else:
                    counts = since[0] >= SOON_S and since[1] >= SOON_TICKS
                if counts and (tick, view) in seen:
                    affected += 1
                    noticed += is_late if expected == "late" else line["state"] == expected
    found = {"affected": affected, "noticed": noticed, "false_alarms": alarms, "healthy_view_hours": seconds / 3600}
    return {**found, "lags_ms": [[flight, *map(round, lag)] for (flight, _), lag in lags.items()]}


def alarms_of(rows):
    """Stretches of images that are alarms of a camera without a fault."""
    ill = [line["state"] not in ("steady", "unknown") for line in rows]
    return sum(state for state, _ in groupby(ill))


def of_clean(corpora):
    """Alarms of cameras without faults, and their hours."""
    alarms, seconds, views = [], 0.0, 0
    for folder in (folder for corpus in corpora for folder in scenarios(corpus)):
        rows_of = pq.read_table(next((folder / "health").glob("*.parquet"))).to_pylist()
        time_ns = pq.read_table(folder / "frames.parquet", columns=["time_ns"])["time_ns"].to_pylist()
        for view in sorted({line["view"] for line in rows_of}):
            rows = [line for line in rows_of if line["view"] == view]
            views += 1
            seconds += (time_ns[-1] - time_ns[0]) / 1e9
            alarms += [f"{folder.name} {view}"] * alarms_of(rows)
    return {"views": views, "view_hours": seconds / 3600, "false_alarms": len(alarms), "where": alarms}


def is_of_first(row):
    """True if a ground-truth box is the first aircraft's; scenarios without traffic have no column of numbers."""
    return not row.get("aircraft_number")


def of_tracks(corpus):
    """Confirmed boxes that are not the aircraft's, and boxes of far aircraft that are not confirmed."""
    counts = {"confirmed_of_aircraft": 0, "confirmed_false": 0, "far_boxes": 0, "far_boxes_not_confirmed": 0}
    for folder in scenarios(corpus):
        truth = pq.read_table(folder / "boxes_truth.parquet").to_pylist()
        truth = {(row["tick"], row["view"]): row for row in truth if row["cx_px"] is not None and is_of_first(row)}
        dtd_m = pq.read_table(folder / "frames.parquet", columns=["tick", "dtd_m"]).to_pylist()
        far = {row["tick"] for row in dtd_m if row["dtd_m"] > 10 * NM}
        for found in pq.read_table(next((folder / "detections").glob("*.parquet"))).to_pylist():
            if found["cx_px"] is None:
                continue
            true = truth.get((found["tick"], found["view"]))
            off = [abs(found[at] - true[at]) for at in ("cx_px", "cy_px")] if true else [np.inf, np.inf]
            is_aircraft = true is not None and off[0] <= true["width_px"] and off[1] <= true["width_px"]
            counts["confirmed_of_aircraft"] += found["confirmed"] and is_aircraft
            counts["confirmed_false"] += found["confirmed"] and not is_aircraft
            counts["far_boxes"] += is_aircraft and found["tick"] in far
            counts["far_boxes_not_confirmed"] += is_aircraft and found["tick"] in far and not found["confirmed"]
    return counts


def boxes(folder):
    """Ticks and views with a box that counts."""
    rows = pq.read_table(next((folder / "detections").glob("*.parquet"))).to_pylist()
    return {(row["tick"], row["view"]) for row in rows if row["cx_px"] is not None and row["confirmed"]}


def repeats(folder, untouched):
    """Ticks whose right image is more like the untouched camera's previous image than like its own, around the aircraft."""
    import av

    truth = pq.read_table(folder / "boxes_truth.parquet").to_pylist()
    centres = {row["tick"]: row for row in truth if row["view"] == "right" and row["cx_px"] is not None and is_of_first(row)}
    images = lambda path: [frame.to_ndarray(format="gray") for frame in av.open(str(path)).decode(video=0)]
    shown, sound = (images(path / "views" / "right.mp4") for path in (folder, untouched))
    found, last = set(), 0
    for tick, image in enumerate(shown):
        row = centres.get(tick)
        if row is None:
            last = tick
            continue
        top, left = max(int(row["cy_px"]) - 60, 0), max(int(row["cx_px"]) - 120, 0)
        part = (slice(top, top + 120), slice(left, left + 240))
        differs = lambda other: float(np.mean((image[part].astype(float) - sound[other][part]) ** 2))
        if tick > 0 and differs(last) < differs(tick):
            found.add(tick)
        else:
            last = tick
    return found


def of_verify(report):
    """Number of findings, views whose messages give a way along the track (late or out of step), and the first messages."""
    findings = report["findings"]
    late = [found for found in findings if "along its track" in found["message"]]
    views = {(found["scenario"], found["view"]) for found in late}
    examples = [f"{found['scenario']} {found['view']} {found['message']}" for found in [*late[:2], *findings[:2]]]
    return {"findings": len(findings), "late_views": len(views), "scenarios": report["scenarios"], "examples": examples}


def beside_untouched(rows):
    """All rows, and coverage beside the untouched corpus's."""
    untouched = rows.get("untouched")
    for name, row in rows.items():
        if untouched and "inverse_range" in row and not name.startswith("trained-"):
            for estimator in ESTIMATORS:
                usual = sum(untouched[estimator]["answered"][flight] for flight in row[estimator]["answered"])
                here = sum(row[estimator]["answered"].values())
                row[estimator]["coverage_of_untouched"] = here / usual if usual else None
                if usual and "within_1_pct" in row[estimator]:
                    row[estimator]["within_1_pct"]["coverage_of_untouched"] = row[estimator]["within_1_pct"]["answered"] / usual
    summary = {}
    for estimator in ("inverse_range_filtered", "inverse_range_smoothed"):
        judged = [name for name in rows if not name.startswith("trained-")]
        kept = [name for name in judged if "intervals_90" in rows[name].get(estimator, {})]
        shares = [rows[name][estimator]["intervals_90"]["held_by_flight"] for name in kept]
        flights = np.array([share for of_row in shares for share in of_row.values()])
        summary[estimator] = {
            "intervals_held_by_row": {name: round(rows[name][estimator]["intervals_90"]["held"], 4) for name in kept},
            "flights": len(flights),
            "flights_below_75": int((flights < 0.75).sum()),
            "flights_below_50": int((flights < 0.5).sum()),
        }
    return {"over_all_rows": summary, "rows": rows}
