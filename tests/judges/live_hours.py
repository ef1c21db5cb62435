"""Hours of `dtd estimate` in real time: its memory over many arrivals, and an empty scene.

    live_hours.py DTD RUN CORPUS FOLDER arrivals [NUMBER]
    live_hours.py DTD RUN CORPUS FOLDER empty [MINUTES]

`arrivals` plays the scenarios of the corpus over RTSP, one after the other, each followed by its empty scene until five minutes are over,
and samples the memory of the process every ten seconds. `empty` plays the scene after the first scenario's landing for so long, as it is
and with noise, to two programs at once. Both print JSON. FOLDER keeps the feeds. Needs ffmpeg.
"""

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

from live_feeds import NOISE, NOISY, as_recorded, join, rate_and_ticks, serve, sources, still

EACH_S, EVERY_S, STARTS_S = 300, 10, 300


def feeds_of_arrivals(scenarios, views, number, encoder, folder):
    for view in views:
        pieces = []
        for place in range(number):
            scenario = scenarios[place % len(scenarios)]
            video = scenario / "views" / f"{view}.mp4"
            rate, ticks = rate_and_ticks(scenario)
            empty = folder / f"{scenario.name}-{view}-after.mp4"
            left_s = EACH_S - ticks / rate
            flown = folder / f"{scenario.name}-{view}.mp4"
            if place < len(scenarios):
                still(video, rate, left_s, encoder, empty)
                join([(video, ticks / rate)], flown)
            pieces += [(flown, ticks / rate), (empty, left_s)]
        join(pieces, folder / f"{view}.mp4")
    return {view: folder / f"{view}.mp4" for view in views}


def memory_mb(pid):
    resident = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{pid}/status").read_text())
    return int(resident[1]) / 1024 if resident else None


def processor_s(pid):
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def watch_arrivals(dtd, run, feeds, number, folder):
    server, addresses = serve(feeds)
    samples, lines = [], folder / "lines.jsonl"
    live = None
    try:
        with lines.open("w") as output:
            live = subprocess.Popen([dtd, "estimate", run, *addresses], stdout=output)
        (folder / "playing.txt").write_text(server.stdout.readline())
        began = time.monotonic()
        while (since_s := time.monotonic() - began) < number * EACH_S and live.poll() is None:
            samples.append((round(since_s), memory_mb(live.pid), processor_s(live.pid)))
            (folder / "memory.json").write_text(json.dumps(samples))
            time.sleep(EVERY_S)
        live.terminate()
        code = live.wait(10)
    finally:
        server.kill()
        if live is not None:
            live.kill()
    return {**of_memory(samples), "exit_code": code, **told(lines, number)}


def of_memory(samples):
    later = [memory for since_s, memory, _ in samples if since_s >= STARTS_S and memory]
    result = {"minutes": round(samples[-1][0] / 60, 1), "processor_of_one_core": round(samples[-1][2] / samples[-1][0], 3)}
    if later:
        result["memory_mb"] = {"at_5_minutes": later[0], "at_end": later[-1], "least": min(later), "most": max(later)}
        result["memory_every_5_minutes_mb"] = [memory for _, memory, _ in samples[:: STARTS_S // EVERY_S]]
    return result


def told(path, arrivals=0):
    """What the lines say about views and aircraft."""
    states, fresh, answers, wrong, images = {}, [0] * arrivals, 0, 0, None
    for line in map(json.loads, path.read_text().splitlines()):
        if line.get("event") == "view":
            states[line["state"]] = states.get(line["state"], 0) + 1
        elif line.get("event") == "end":
            images = line["images"]
        elif line.get("state") == "fresh" and line["dtd_m"] is not None and line["time_s"] < arrivals * EACH_S:
            fresh[int(line["time_s"] // EACH_S)] += 1
        answers += line.get("dtd_m") is not None
        wrong += line.get("phase") == "other" and line["dtd_m"] is not None
    return {"view_states": states, "fresh_by_arrival": fresh, "distances": answers, "distances_of_others": wrong, "images": images}


def watch_empty(dtd, run, scenario, views, minutes, encoder, folder):
    rate, _ = rate_and_ticks(scenario)
    running = {}
    for name, encoder, noise in (("without_noise", encoder, ""), ("with_noise", NOISY, NOISE)):
        videos = {}
        for view in views:
            minute, path = folder / f"empty-{name}-{view}-minute.mp4", folder / f"empty-{name}-{view}.mp4"
            still(scenario / "views" / f"{view}.mp4", rate, 60, encoder, minute, noise)
            join([(minute, 60)] * minutes, path)
            videos[view] = path
        lines = folder / f"empty-{name}.jsonl"
        with lines.open("w") as output:
            running[name] = lines, subprocess.Popen([dtd, "estimate", run, *sources(videos)], stdout=output)
    result = {}
    for name, (lines, live) in running.items():
        code = live.wait()
        result[name] = {"minutes": minutes, "images_per_s": rate, "exit_code": code, **told(lines)}
    return result


def main():
    dtd, run, corpus, folder, kind, *number = sys.argv[1:]
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    scenarios = sorted(path.parent for path in Path(corpus).glob("scenarios/*/DONE.json"))
    encoder = as_recorded(Path(corpus))
    views = json.loads((scenarios[0] / "scenario.json").read_text())["views"]
    if kind == "arrivals":
        number = int(number[0]) if number else 12
        feeds = feeds_of_arrivals(scenarios, views, number, encoder, folder)
        result = watch_arrivals(dtd, run, feeds, number, folder)
    else:
        result = watch_empty(dtd, run, scenarios[0], views, int(number[0]) if number else 60, encoder, folder)
    print(json.dumps(result, indent=1))


main()
