"""How soon `dtd estimate` notices that a view over RTSP fails: killed, stopped, frozen, black, each several times.

    live_failures.py DTD RUN CORPUS FOLDER TIMES [RATE]

Serves the scene after the landing of the corpus's first scenario, with noise, at RATE images per second (30), with rtsp_server.py, which
causes the failures of the first view. A frozen camera's encoder goes on: it encodes one noisy image again and again. Prints JSON: seconds
until the program says so, on stdout, and until the view is `up` again. FOLDER keeps the feeds. Needs ffmpeg.
"""

import json
import signal
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path

from live_feeds import NOISE, NOISY, join, rate_and_ticks, serve, still

QUIET_S, FAILS_S, MOST_S, PIECE_S = 4.0, 2.5, 8.0, 20
# x264 compresses more at higher rates: by NOISY's factor, 26, only key frames have noise at 30 images per second, and by 22 others change
# by 0.026 grey levels, hardly more than a picture that stands still; by 21 they change by 0.1.
WITH_NOISE = NOISY.replace("-crf 26", "-crf 21")


class Program:
    """`dtd estimate`, with the times at which it said that a view has a state."""

    def __init__(self, command):
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.said = []
        threading.Thread(target=self.read, daemon=True).start()

    def read(self):
        for line in self.process.stdout:
            line = json.loads(line)
            if line.get("event") == "view":
                self.said.append((time.time(), line["view"], line["state"]))

    def wait(self, view, states, since_s):
        """Seconds from a time until a view has one of these states."""
        while time.time() < since_s + MOST_S:
            for at_s, of_view, state in list(self.said):
                if at_s >= since_s and of_view == view and state in states:
                    return at_s - since_s
            time.sleep(0.005)
        sys.exit(f"view {view} has none of the states {states}: {self.said[-5:]}")


def percentile(numbers, part):
    ordered = sorted(numbers)
    return ordered[min(len(ordered) - 1, round(part * len(ordered)))]


def feeds(corpus, folder, rate, lasts_s):
    """Noisy scenes by view, a black one, and one of the first view that stands still."""
    folder.mkdir(parents=True, exist_ok=True)
    scenario = min(path.parent for path in Path(corpus).glob("scenarios/*/DONE.json"))
    own_rate, _ = rate_and_ticks(scenario)
    pieces = {view: f",fps={rate}{NOISE}" for view in json.loads((scenario / "scenario.json").read_text())["views"]}
    first = next(iter(pieces))
    pieces["black"] = f",fps={rate},drawbox=c=black:t=fill"
    pieces["still"] = f"{pieces[first]},trim=end_frame=1,loop=loop={rate * PIECE_S - 1}:size=1,setpts=N/{rate}/TB"
    videos = {}
    for name, look in pieces.items():
        video = scenario / "views" / f"{first if name in ('black', 'still') else name}.mp4"
        piece, videos[name] = folder / f"{name}-piece.mp4", folder / f"{name}.mp4"
        still(video, own_rate, PIECE_S, WITH_NOISE.replace("-g 60", f"-g {rate}") + f" -r {rate}", piece, look)
        join([(piece, PIECE_S)] * (lasts_s // PIECE_S + 1), videos[name])
    return videos


def main():
    dtd, run, corpus, folder, times, *rate = sys.argv[1:]
    lasts_s = int(4 * int(times) * (QUIET_S + FAILS_S + MOST_S))
    videos = feeds(corpus, Path(folder), int(rate[0]) if rate else 30, lasts_s)
    others = {name: videos.pop(name) for name in ("black", "still")}
    view = next(iter(videos))
    server, addresses = serve(videos, *(f"{view}:{name}={video}" for name, video in others.items()))
    program = Program([dtd, "estimate", run, *addresses])
    try:
        print(json.dumps(measured(program, server, view, int(times)), indent=1))
    finally:
        program.process.terminate()
        server.kill()


def measured(program, server, view, times):
    def command(text):
        server.stdin.write(text + "\n")
        server.stdin.flush()

    def at_next_key_frame(text):
        command(text)
        return float(server.stdout.readline().split()[1])

    # What begins and ends a failure, and what it is called.
    failures = {
        "killed": (lambda: command(f"drop {view}"), lambda: command(f"offer {view}"), ["late", "down"]),
        "stopped": (lambda: server.send_signal(signal.SIGSTOP), lambda: server.send_signal(signal.SIGCONT), ["late", "down"]),
        "frozen": (lambda: at_next_key_frame(f"switch {view} still"), lambda: at_next_key_frame(f"switch {view}"), ["frozen"]),
        "black": (lambda: at_next_key_frame(f"switch {view} black"), lambda: at_next_key_frame(f"switch {view}"), ["dark"]),
    }
    server.stdout.readline()  # They are playing.
    program.wait(view, ["up"], time.time() - 1)
    result = {}
    for name, (begin, end, states) in failures.items():
        noticed, back = [], []
        for _ in range(times):
            time.sleep(QUIET_S)
            began_s = time.time()
            began_s = begin() or began_s
            noticed.append(program.wait(view, states, began_s))
            time.sleep(max(0, began_s + FAILS_S - time.time()))
            ended_s = time.time()
            ended_s = end() or ended_s
            back.append(program.wait(view, ["up"], ended_s))
        result[name] = {
            "times": len(noticed),
            "noticed_p50_s": round(statistics.median(noticed), 3),
            "noticed_p95_s": round(percentile(noticed, 0.95), 3),
            "up_again_p95_s": round(percentile(back, 0.95), 3),
        }
    return result


main()
