"""Aircraft that do not arrive, for `dtd estimate`: how many ticks of each have a distance, and how many later than five seconds.

    live_others.py DTD RUN CORPUS FOLDER

Takes the first scenario of the corpus (docs/results/live-figures.toml: an approach to the touchdown, 30 images per second) and shows its
images in another order or at another speed, so that size and place in both views still fit together: `departs` are the last 40 s backwards,
five images per second; `taxis` and `taxis_away` the last 8 s at a sixth of the speed, 14 m/s, forwards and backwards. The feeds are encoded
as the corpus was. Prints JSON. FOLDER keeps the feeds and the lines. Needs ffmpeg.
"""

import json
import subprocess
import sys
from pathlib import Path

from live_feeds import COLOURS, as_recorded, ffmpeg, rate_and_ticks, sources

RATE, SETTLED_S = 5, 5.0
# Seconds of the end of the video, and what is done with them.
KINDS = {
    "departs": (40, f"fps={RATE},reverse,setpts=N/{RATE}/TB"),
    "taxis": (8, f"setpts=N/{RATE}/TB"),
    "taxis_away": (8, f"reverse,setpts=N/{RATE}/TB"),
}


def feeds(scenario, views, encoder, kind, folder):
    last_s, look = KINDS[kind]
    paths = {}
    for view in views:
        video, paths[view] = scenario / "views" / f"{view}.mp4", folder / f"{kind}-{view}.mp4"
        encoding = [*encoder.split(), *COLOURS.split(), "-r", RATE]
        ffmpeg("-sseof", -last_s, "-i", video, "-vf", look, *encoding, paths[view])
    return paths


def judged(lines):
    answers = [line for line in lines if "state" in line and "event" not in line]
    if not answers:
        sys.exit("the aircraft was never seen")
    first_s = answers[0]["time_s"]
    with_distance = [line["time_s"] - first_s for line in answers if line["dtd_m"] is not None]
    return {
        "seen_s": round(answers[-1]["time_s"] - first_s, 1),
        "answers_from_both_views": sum(len(line["views"]) == 2 for line in answers),
        "with_a_distance": len(with_distance),
        "with_a_distance_after_5_s": sum(since_s > SETTLED_S for since_s in with_distance),
        "last_distance_s": round(max(with_distance), 1) if with_distance else None,
    }


def main():
    dtd, run, corpus, folder = sys.argv[1:]
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    scenario = min(path.parent for path in Path(corpus).glob("scenarios/*/DONE.json"))
    if rate_and_ticks(scenario)[0] != 30:
        sys.exit("the scenario has another frame rate than 30")
    views = json.loads((scenario / "scenario.json").read_text())["views"]
    result = {}
    for kind in KINDS:
        paths = feeds(scenario, views, as_recorded(Path(corpus)), kind, folder)
        output = folder / f"{kind}.jsonl"
        with output.open("w") as lines:
            subprocess.run([dtd, "estimate", run, *sources(paths), "--as-fast-as-possible"], stdout=lines, check=True)
        result[kind] = judged([json.loads(line) for line in output.read_text().splitlines()])
    print(json.dumps(result, indent=1))


main()
