"""Figures of `dtd estimate` over RTSP with cameras that are hard to follow.

    live_cameras.py DTD RUN CORPUS FOLDER [CASE ..]

Takes the first scenario of the corpus (docs/results/live-figures.toml: an approach, 30 images per second), and serves it with rtsp_server.py.
Cases: `slices`: 5 images per second in slices of at most 1,400 bytes, so that each image has a different number; latency of the first 30
pairs and of the later ones, as in live_figures.py. `counts`: 21 images per second whose timestamps count 25; seconds until answers are fresh,
and their part from then on. `starved`: 5 images per second for 72 s with a tenth of one core; fresh answers of 360 (needs to be root, for the
control group). Prints JSON. FOLDER keeps the feeds. Needs ffmpeg.
"""

import json
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

from live_feeds import COLOURS, as_recorded, ffmpeg, serve
from live_figures import percentiles, started

FIRST = 30
CORES, STARVED_S = 0.1, 72


def feeds(scenario, encoder, rate, folder, name):
    """The views' videos at another rate."""
    paths = {}
    for view in json.loads((scenario / "scenario.json").read_text())["views"]:
        paths[view] = folder / f"{name}-{view}.mp4"
        if not paths[view].exists():
            video = scenario / "views" / f"{view}.mp4"
            ffmpeg("-i", video, "-vf", f"fps={rate}", *encoder.replace("-g 60", f"-g {rate}").split(), *COLOURS.split(), paths[view])
    return paths


class Lines:
    """Lines of a program with the seconds after which they came."""

    def __init__(self, process, began_s):
        self.all = []
        threading.Thread(target=self.read, args=(process, began_s), daemon=True).start()

    def read(self, process, began_s):
        for line in process.stdout:
            self.all.append((time.monotonic() - began_s, json.loads(line)))

    def fresh(self):
        """Times of fresh answers."""
        return sorted({line["time_s"]: at_s for at_s, line in self.all if line.get("state") == "fresh"}.values())


def counted(text):
    return int(re.search(r'dtd_latency_seconds_count{stage="total"} (\d+)', text)[1])


def slices(command, server):
    live, metrics = started(command, stdout=subprocess.DEVNULL)
    while counted(first := metrics()) < FIRST:
        time.sleep(0.1)
    time.sleep(45)
    whole = metrics()
    live.terminate()
    return {"first": {"pairs": counted(first), **percentiles(first, "total")}, "all": {"pairs": counted(whole), **percentiles(whole, "total")}}


def counts(command, server):
    for view in ("left", "right"):
        server.stdin.write(f"count {view} 25\n")
    server.stdin.flush()
    began_s = time.monotonic()
    live = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    lines = Lines(live, began_s)
    time.sleep(60)
    live.terminate()
    up_s = max(at_s for at_s, line in lines.all if line.get("event") == "view" and line["state"] == "up" and at_s < 5)
    fresh_s = lines.fresh()
    late_s = [at_s for at_s, line in lines.all if line.get("state") == "coasting"]
    settled = [at_s for at_s in fresh_s if at_s >= up_s + 10]
    coasting = [at_s for at_s in late_s if at_s >= up_s + 10]
    return {
        "clocks": sorted({line["clock"] for _, line in lines.all if line.get("clock")}),
        "first_fresh_after_s": round(fresh_s[0] - up_s, 2) if fresh_s else None,
        "fresh_part_after_10_s": round(len(settled) / max(1, len(settled) + len(coasting)), 3),
    }


def control_group(cores):
    """A new group of processes with so much processor time."""
    whole, name = 100_000, "dtd-starved"
    first = Path("/sys/fs/cgroup/cpu")
    group = (first if first.exists() else first.parent) / name
    group.mkdir(exist_ok=True)
    if first.exists():
        (group / "cpu.cfs_period_us").write_text(str(whole))
        (group / "cpu.cfs_quota_us").write_text(str(int(cores * whole)))
    else:
        (group / "cpu.max").write_text(f"{int(cores * whole)} {whole}")
    return group / "cgroup.procs"


def starved(command, server):
    members = control_group(CORES)
    began_s = time.monotonic()
    live = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=lambda: members.write_text(str(os.getpid())))
    lines = Lines(live, began_s)
    server.stdout.readline()  # They are playing.
    time.sleep(STARVED_S)
    live.terminate()
    live.wait(20)
    members.parent.rmdir()
    return {"cores": CORES, "fresh": len(lines.fresh()), "of": 5 * STARVED_S}


CASES = {"slices": (slices, 5), "counts": (counts, 21), "starved": (starved, 5)}


def main():
    if len(sys.argv) < 5:
        sys.exit(__doc__)
    dtd, run, corpus, folder, *cases = sys.argv[1:]
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    scenario = min(path.parent for path in Path(corpus).glob("scenarios/*/DONE.json"))
    result = {}
    for case in cases or CASES:
        judge, rate = CASES[case]
        encoder = as_recorded(Path(corpus))
        if case == "slices":
            encoder = encoder.replace("-x264-params ", "-x264-params slice-max-size=1400:")
        server, addresses = serve(feeds(scenario, encoder, rate, folder, case))
        try:
            result[case] = judge([dtd, "estimate", run, *addresses], server)
        finally:
            server.kill()
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
