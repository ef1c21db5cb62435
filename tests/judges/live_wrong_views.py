"""Estimates arrivals from views that do not belong to the run's cameras or to each other, and adds to a JSON what was answered.

Usage: live_wrong_views.py RUN CORPUS OUT.json [KIND ..]. CORPUS: two views, cameras as in the training, at least two flights of each light
and weather. Needs pyarrow, numpy and PyAV, and the program as $DTD (default target/release/dtd). Flights are estimated from their video
files, as fast as possible. Kinds that OUT.json has already are not made again.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import av
from live_truth import NM_M, errors, mean, true_m, truth_of

sys.path.append(str(Path(__file__).parents[2] / "scripts"))
from made_by import made_by

DTD = Path(os.environ.get("DTD", Path(__file__).parents[2] / "target/release/dtd")).resolve()
VIEWS = ["left", "right"]


def redrawn(video, folder, change):
    """A copy, nearly as sharp, whose images (height x width x 3) are changed."""
    path = folder / f"redrawn-{video.name}"
    with av.open(str(video)) as source, av.open(str(path), "w") as target:
        stream = source.streams.video[0]
        copy = target.add_stream("libx264", rate=stream.average_rate, options={"crf": "12", "preset": "superfast", "bf": "0"})
        copy.width, copy.height, copy.pix_fmt, copy.time_base = stream.width, stream.height, "yuv420p", stream.time_base
        for image in source.decode(stream):
            drawn = av.VideoFrame.from_ndarray(change(image.to_ndarray(format="rgb24")), format="rgb24")
            drawn.pts, drawn.time_base = image.pts, image.time_base
            target.mux(copy.encode(drawn))
        target.mux(copy.encode())
    return path


def mirrored(image):
    return image[:, ::-1].copy()


def other_third(image):
    """The left third of the ground, which begins at row 880, as the right third looks: a building site."""
    changed, third = image.copy(), image.shape[1] // 3
    changed[880:, :third] = image[880:, -third:]
    return changed


def copied(video, folder):
    """The same images under a different name: two recordings of one camera."""
    path = folder / f"copy-{video.name}"
    path.write_bytes(video.read_bytes())
    return path


# Sources of the two views, from the flight's own videos and a different flight's in the same light and weather.
KINDS = {
    "untouched": lambda own, other, folder: own,
    "exchanged": lambda own, other, folder: own[::-1],
    "right mirrored": lambda own, other, folder: [own[0], redrawn(own[1], folder, mirrored)],
    "both mirrored and exchanged": lambda own, other, folder: [redrawn(own[1], folder, mirrored), redrawn(own[0], folder, mirrored)],
    "left twice": lambda own, other, folder: [own[0], copied(own[0], folder)],
    "two flights": lambda own, other, folder: [own[0], other[1]],
    "a third of the ground changed": lambda own, other, folder: [own[0], redrawn(own[1], folder, other_third)],
}


def estimated(run, sources):
    """Lines of the program."""
    views = [option for view, source in zip(VIEWS, sources) for option in ("--view", f"{view}={source}")]
    command = [DTD, "estimate", run, "--as-fast-as-possible", *views]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def judged(lines, truth):
    """Answers by the number of their views, and when the fault was first named after an aircraft was seen."""
    answers = [line for line in lines if line.get("dtd_m") is not None and line["state"] != "lost"]
    found = {"first_answer_s": answers[0]["time_s"] if answers else None}
    for count in (1, 2):
        of_count = [line for line in answers if len(line["views"]) == count]
        errors_pct = errors([(line["time_s"], line["dtd_m"]) for line in of_count], truth)
        true = [(line, true_m(truth, line["time_s"])) for line in of_count]
        held = [line["dtd_from_m"] <= dtd_m <= line["dtd_to_m"] for line, dtd_m in true if dtd_m and NM_M <= dtd_m <= 10 * NM_M]
        figures = {"answers": len(errors_pct), "mape_pct": mean(errors_pct), "worst_pct": max(errors_pct, default=None)}
        found[f"with_{count}"] = {**figures, "held_90": mean(held)}
    # A camera whose surroundings are unknown is not found to be wrong.
    named = [line for line in lines if line.get("event") in ("camera", "withheld") and line["why"] and line.get("shows") != "unknown"]
    found["named_s"] = named[0]["time_s"] if named else None
    found["named"] = {line["view"]: line.get("reason") or line["shows"] for line in named}
    return found


def main():
    if len(sys.argv) < 4:
        sys.exit(__doc__)
    run, corpus, out = (Path(argument).resolve() for argument in sys.argv[1:4])
    flights = sorted((corpus / "scenarios").iterdir())
    condition = lambda flight: flight.name.rsplit("-", 1)[0]
    found = json.loads(out.read_text()) if out.exists() else {}
    for kind in sys.argv[4:] or KINDS:
        if kind in found:
            continue
        by_flight = {}
        for flight in flights:
            other = next(one for one in flights if one != flight and condition(one) == condition(flight))
            videos = [[one / "views" / f"{view}.mp4" for view in VIEWS] for one in (flight, other)]
            with tempfile.TemporaryDirectory() as folder:
                lines = estimated(run, KINDS[kind](*videos, Path(folder)))
            by_flight[flight.name] = judged(lines, truth_of(flight))
        found[kind] = {**made_by(run, corpus), "by_flight": by_flight}
        out.write_text(json.dumps(found, indent=1) + "\n")
        print(f"{kind}: done", flush=True)


if __name__ == "__main__":
    main()
