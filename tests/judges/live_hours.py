"""Hours of `dtd estimate`, as fast as possible: an empty scene with and without noise, arrivals, and aircraft that fly away.

    live_hours.py DTD RUN CORPUS FOLDER HOURS

Composes files of a corpus's scenarios without encoding their images again, as long as that many hours, and prints JSON: views that were
called frozen, distances of aircraft that go away (after 5 s), and the memory of the program over the arrivals. Needs ffmpeg.
"""

import json
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

CLIP_S = 60
GAP_S = 60


def ffmpeg(*arguments):
    subprocess.run(["ffmpeg", "-v", "error", "-y", *map(str, arguments)], check=True)


def looped(clips, seconds, gap_s, path):
    """Joins clips of these lengths, with gaps, again and again."""
    playlist, at_s, number = [], 0.0, 0
    while at_s < seconds:
        clip, lasts_s = clips[number % len(clips)]
        playlist.append(f"file '{clip.resolve()}'\nduration {lasts_s + gap_s}\n")
        at_s += lasts_s + gap_s
        number += 1
    listed = path.with_suffix(".txt")
    listed.write_text("".join(playlist))
    ffmpeg("-f", "concat", "-safe", "0", "-i", listed, "-c", "copy", "-video_track_timescale", "90000", path)
    return path


def run_on(dtd, run, sources):
    """The lines of the program and its memory, by time."""
    views = [part for view, path in sources.items() for part in ("--view", f"{view}={path}")]
    began_s = time.monotonic()
    program = subprocess.Popen([dtd, "estimate", run, *views, "--as-fast-as-possible"], stdout=subprocess.PIPE, text=True)
    memory = []

    def watch():
        while program.poll() is None:
            found = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{program.pid}/status").read_text())
            if found:
                memory.append((time.monotonic() - began_s, int(found[1]) / 1024))
            time.sleep(0.5)

    threading.Thread(target=watch, daemon=True).start()
    lines = [json.loads(line) for line in program.stdout]
    if program.wait() != 0:
        sys.exit("dtd estimate failed")
    return lines, memory


def summary(lines, memory, took):
    views = [line for line in lines if line.get("event") == "view"]
    answers = [line for line in lines if "track" in line]
    seen = {}
    for answer in answers:
        seen.setdefault(answer["track"], answer["time_s"])
    late = [answer for answer in answers if answer["dtd_m"] is not None and answer["time_s"] > seen[answer["track"]] + 5]
    parts = [memory[int(part * (len(memory) - 1))][1] for part in (0.1, 0.25, 0.5, 0.75, 1.0)]
    return {
        "hours": round(max(line["time_s"] for line in lines) / 3600, 3),
        "took_s": round(took, 1),
        "images": next(line["images"] for line in lines if line.get("event") == "end"),
        "frozen": sum(line["state"] == "frozen" for line in views),
        "other_states": sorted({line["state"] for line in views} - {"up", "frozen"}),
        "answers": len(answers),
        "tracks": len(seen),
        "distances_after_5_s": len(late),
        "memory_mb_at_10_25_50_75_100_percent": [round(part) for part in parts],
        "memory_mb_most": round(max(part for _, part in memory)),
    }


def main():
    dtd, run, corpus, folder, hours = sys.argv[1], sys.argv[2], Path(sys.argv[3]), Path(sys.argv[4]), float(sys.argv[5])
    folder.mkdir(parents=True, exist_ok=True)
    scenarios = sorted(path for path in (corpus / "scenarios").iterdir() if (path / "DONE.json").exists())
    rates = {path: json.loads((path / "scenario.json").read_text()) for path in scenarios}
    per_s = rates[scenarios[0]]["frame_rate"]
    per_s = per_s["numerator"] / per_s["denominator"]
    x264 = ("-g", per_s * 2, "-c:v", "libx264", "-preset", "ultrafast", "-crf", "26")
    sources = {name: {} for name in ("still_with_noise", "still_without_noise", "arrivals", "going_away")}
    for view in ("left", "right"):
        videos = [(path / "views" / f"{view}.mp4", rates[path]["ticks"] / per_s) for path in scenarios]
        for name, noise in (("still_with_noise", ",noise=alls=4:allf=t"), ("still_without_noise", "")):
            clip = folder / f"{view}-{name}-clip.mp4"
            # The first image, with the aircraft far away painted over.
            still = f"trim=end_frame=1,delogo=x=2:y=2:w=1916:h=600,loop=loop={int(CLIP_S * per_s) - 1}:size=1,setpts=N/{per_s}/TB{noise}"
            ffmpeg("-i", videos[0][0], "-vf", still, "-r", per_s, *x264, clip)
            sources[name][view] = looped([(clip, CLIP_S)], hours * 3600, 0, folder / f"{view}-{name}.mp4")
        sources["arrivals"][view] = looped(videos, hours * 3600, GAP_S, folder / f"{view}-arrivals.mp4")
        away = folder / f"{view}-away-clip.mp4"
        # The last minutes of an arrival, backwards.
        tail = f"trim=start={videos[0][1] - 100},setpts=PTS-STARTPTS,reverse"
        ffmpeg("-i", videos[0][0], "-vf", tail, *x264, away)
        sources["going_away"][view] = looped([(away, 100)], 500, GAP_S, folder / f"{view}-away.mp4")
    result = {}
    for name, of_views in sources.items():
        began_s = time.monotonic()
        lines, memory = run_on(dtd, run, of_views)
        result[name] = summary(lines, memory, time.monotonic() - began_s)
        print(f"{name} done", file=sys.stderr)
    print(json.dumps(result, indent=1))


main()
