"""Hours of `dtd estimate` in real time: its memory over many arrivals, and an empty scene.

    live_hours.py DTD RUN CORPUS FOLDER arrivals [NUMBER]
    live_hours.py DTD RUN CORPUS FOLDER empty [MINUTES]
    live_hours.py judge FOLDER

`arrivals` plays the scenarios of the corpus over RTSP, one after the other, each followed by its empty scene until five minutes are over,
and samples the memory of the process every ten seconds. An empty scene comes first, because a view that is opened between two key frames
waits for the next. `empty` shows the scene after the first scenario's landing for so long, as it is
and with noise, other noise in each minute, to two programs at once, which read it as fast as possible. Both print JSON, and `judge` prints it again from what they have
left in FOLDER. FOLDER keeps the feeds. Needs ffmpeg.
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
# Longer than the time between two key frames, twelve seconds.
LEAD_S = 20


def feeds_of_arrivals(scenarios, views, number, encoder, folder):
    for view in views:
        lead = folder / f"before-{view}.mp4"
        still(scenarios[0] / "views" / f"{view}.mp4", rate_and_ticks(scenarios[0])[0], LEAD_S, encoder, lead)
        pieces = [(lead, LEAD_S)]
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
    samples, live = [], None
    try:
        with (folder / "lines.jsonl").open("w") as output:
            live = subprocess.Popen([dtd, "estimate", run, *addresses], stdout=output)
        (folder / "playing.txt").write_text(server.stdout.readline())
        began = time.monotonic()
        while (since_s := time.monotonic() - began) < LEAD_S + number * EACH_S and live.poll() is None:
            samples.append((round(since_s), memory_mb(live.pid), processor_s(live.pid)))
            (folder / "memory.json").write_text(json.dumps(samples))
            time.sleep(EVERY_S)
        live.terminate()
        if live.wait(10) != 0:
            sys.exit("dtd failed")
    finally:
        server.kill()
        if live is not None:
            live.kill()


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
        elif line.get("state") == "fresh" and line["dtd_m"] is not None:
            place = int((line["time_s"] - LEAD_S) // EACH_S)
            if 0 <= place < arrivals:
                fresh[place] += 1
        answers += line.get("dtd_m") is not None
        wrong += line.get("phase") == "other" and line["dtd_m"] is not None
    return {"view_states": states, "fresh_by_arrival": fresh, "distances": answers, "distances_of_others": wrong, "images": images}


def watch_empty(dtd, run, scenario, views, minutes, encoder, folder):
    rate, _ = rate_and_ticks(scenario)
    running = []
    try:
        other_each_minute = [f"{NOISE}:all_seed={minute}" for minute in range(minutes)]
        for name, encoder, noises in (("without_noise", encoder, [""]), ("with_noise", NOISY, other_each_minute)):
            videos = {}
            for view in views:
                pieces = [folder / f"empty-{name}-{view}-{minute}.mp4" for minute in range(len(noises))]
                for piece, noise in zip(pieces, noises):
                    still(scenario / "views" / f"{view}.mp4", rate, 60, encoder, piece, noise)
                videos[view] = folder / f"empty-{name}-{view}.mp4"
                join([(pieces[minute % len(pieces)], 60) for minute in range(minutes)], videos[view])
            with (folder / f"empty-{name}.jsonl").open("w") as output:
                command = [dtd, "estimate", run, *sources(videos), "--as-fast-as-possible"]
                running.append(subprocess.Popen(command, stdout=output))
        if any(live.wait() != 0 for live in running):
            sys.exit("dtd failed")
    finally:
        for live in running:
            live.kill()


def judged(folder):
    """The results of what was left in a folder."""
    if (folder / "memory.json").exists():
        samples = json.loads((folder / "memory.json").read_text())
        return {**of_memory(samples), **told(folder / "lines.jsonl", round(len(samples) * EVERY_S / EACH_S))}
    return {name: told(folder / f"empty-{name}.jsonl") for name in ("without_noise", "with_noise")}


def main():
    if sys.argv[1] == "judge":
        print(json.dumps(judged(Path(sys.argv[2])), indent=1))
        return
    dtd, run, corpus, folder, kind, *number = sys.argv[1:]
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    scenarios = sorted(path.parent for path in Path(corpus).glob("scenarios/*/DONE.json"))
    encoder = as_recorded(Path(corpus))
    views = json.loads((scenarios[0] / "scenario.json").read_text())["views"]
    number = int(number[0]) if number else {"arrivals": 12, "empty": 60}[kind]
    if kind == "arrivals":
        watch_arrivals(dtd, run, feeds_of_arrivals(scenarios, views, number, encoder, folder), number, folder)
    else:
        watch_empty(dtd, run, scenarios[0], views, number, encoder, folder)
    print(json.dumps(judged(folder), indent=1))


main()
