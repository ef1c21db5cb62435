"""Adds false boxes to the detections of a copy of a corpus, with scores above the aircraft's, to judge what estimators do with them.

Usage: compose_boxes.py CORPUS OUT KIND. Needs pyarrow and b3sum. Images, registrations and health stay as they
are, so these rows judge pairing alone. KIND is one of

- still, moving: one box in one view at a time, for 1 to 60 seconds, every 75 seconds;
- replaced: the same, and the box of the aircraft is missing in that view meanwhile;
- missing: the aircraft alone is missing there, for comparison;
- arrival-behind, arrival-ahead: the boxes of another flight of the corpus in all views, 60 seconds later or earlier;
- one-view-arrival: the latter in the first view alone.

OUT/other-arrivals.json has the distances of the other flight at the ticks of each scenario.
"""

import json
import random
import shutil
import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

LASTS_S = [1, 3, 10, 30, 60]
EVERY_S = 75
OFFSET_S = {"arrival-behind": 60, "arrival-ahead": -60, "one-view-arrival": -60}
KINDS = ["still", "moving", "replaced", "missing", *OFFSET_S]
# Tracks of the false boxes; the detector's are below.
FIRST_TRACK = 1_000
WIDTH_PX, HEIGHT_PX, EDGE_PX = 1920, 1280, 4


def row(tick, view, centre, size, track):
    """A row of the table; None for a box that the edge of the image would cut off."""
    (x, y), (width, height) = centre, size
    left, top = x - width / 2, y - height / 2
    if left < EDGE_PX or top < EDGE_PX or left + width > WIDTH_PX - EDGE_PX or top + height > HEIGHT_PX - EDGE_PX:
        return None
    box = {"cx_px": x, "cy_px": y, "width_px": width, "height_px": height}
    other = {"score": 0.99, "tile": 0, "track": track, "mode": "full", "confirmed": True, "counts_live": True, "reason": None}
    return {"tick": tick, "view": view, **box, **other}


def single_boxes(kind, number, boxes, seconds, chance):
    """Boxes in one view at a time, among the places and sizes of the flight's own."""
    views = sorted({box["view"] for box in boxes})
    ends = {key: (min(b[key] for b in boxes), max(b[key] for b in boxes)) for key in ("cx_px", "cy_px", "width_px")}
    start, stretch, last = chance.uniform(0, 20), 0, max(seconds.values())
    while start < last:
        lasts = LASTS_S[(stretch + number) % len(LASTS_S)]
        view = chance.choice(views)
        x, y = chance.uniform(*ends["cx_px"]), chance.uniform(*ends["cy_px"])
        width = chance.uniform(ends["width_px"][0], 0.6 * ends["width_px"][1])
        speed = (chance.uniform(-15, 15), chance.uniform(-1, 2)) if kind == "moving" else (0, 0)
        for tick, second in seconds.items():
            since = second - start
            if 0 <= since < lasts:
                centre = (x + speed[0] * since, y + speed[1] * since)
                yield row(tick, view, centre, (width, 0.35 * width), FIRST_TRACK + stretch)
        start += EVERY_S
        stretch += 1


def ticks_later(kind, seconds):
    period = max(seconds.values()) / (len(seconds) - 1)
    return round(OFFSET_S[kind] / period)


def arrival(kind, boxes, other, seconds):
    """The boxes of another flight at another time."""
    first_view = min(box["view"] for box in boxes)
    later = ticks_later(kind, seconds)
    for box in other:
        tick = box["tick"] + later
        if tick in seconds and (kind != "one-view-arrival" or box["view"] == first_view):
            centre, size = (box["cx_px"], box["cy_px"]), (box["width_px"], box["height_px"])
            yield row(tick, box["view"], centre, size, FIRST_TRACK + (box["track"] or 0))


def replace(path, rows, schema):
    """Writes the table and its hash in the record next to it."""
    path.unlink()
    pq.write_table(pa.Table.from_pylist(rows, schema=schema), path, compression="zstd")
    record = path.with_suffix(".json")
    made = json.loads(record.read_text())
    hashed = subprocess.run(["b3sum", "--no-names", path], capture_output=True, text=True, check=True)
    made["table_blake3"] = hashed.stdout.strip()
    record.write_text(json.dumps(made, indent=2))


def main():
    corpus, out, kind = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]
    if kind not in KINDS:
        sys.exit(f"KIND is {kind}, expected one of {', '.join(KINDS)}")
    shutil.copytree(corpus, out)
    scenarios = sorted(folder for folder in (out / "scenarios").iterdir() if (folder / "detections").is_dir())
    paths = [next((folder / "detections").glob("*.parquet")) for folder in scenarios]
    tables = [pq.read_table(path) for path in paths]
    rows_of = [table.to_pylist() for table in tables]
    boxes_of = [[r for r in rows if r["cx_px"] is not None and r["confirmed"]] for rows in rows_of]
    flown = [pq.read_table(folder / "frames.parquet", columns=["tick", "time_ns", "dtd_m"]).to_pylist() for folder in scenarios]
    others = {}
    for number, folder in enumerate(scenarios):
        frames, other = flown[number], flown[(number + 1) % len(scenarios)]
        seconds = {frame["tick"]: frame["time_ns"] / 1e9 for frame in frames}
        if kind in OFFSET_S:
            later = ticks_later(kind, seconds)
            others[folder.name] = {frame["tick"] + later: frame["dtd_m"] for frame in other}
            added = arrival(kind, boxes_of[number], boxes_of[(number + 1) % len(scenarios)], seconds)
        else:
            chance = random.Random(f"{'replaced' if kind == 'missing' else kind} {folder.name}")
            added = single_boxes(kind, number, boxes_of[number], seconds, chance)
        added = [new for new in added if new]
        where = {(new["tick"], new["view"]) for new in added}
        # An image with a box has no row that says why there is none.
        dropped = lambda r: (r["tick"], r["view"]) in where and (kind in ("replaced", "missing") or r["cx_px"] is None)
        kept = [r for r in rows_of[number] if not dropped(r)]
        if kind == "missing":
            none = dict.fromkeys(("cx_px", "cy_px", "width_px", "height_px", "score", "tile", "track"))
            none |= {"mode": "full", "confirmed": False, "counts_live": False, "reason": "nothing"}
            added = [{"tick": tick, "view": view, **none} for tick, view in where]
        replace(paths[number], sorted(kept + added, key=lambda r: r["tick"]), tables[number].schema)
        print(f"{folder.name}: {len(added)} boxes")
    if others:
        (out / "other-arrivals.json").write_text(json.dumps(others))


main()
