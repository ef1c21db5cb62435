"""Figures of `dtd estimate` over RTSP: images searched, processor time, latency.

    live_figures.py DTD RUN SECONDS VIEW=VIDEO.mp4 ...

Serves the videos with rtsp_server.py, without encoding, runs `dtd estimate` for so many seconds, and prints JSON. Latency is from the arrival
of the last packet of the later image to the line, as the program's own histogram has it: each percentile is the upper end of its class
(classes of at most 5 ms up to 0.1 s), so the true one is not above it.
"""

import json
import os
import re
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

from live_feeds import serve


def percentiles(text, stage):
    pattern = rf'dtd_latency_seconds_bucket{{stage="{stage}",le="([^"]+)"}} (\d+)'
    classes = [(end, int(count)) for end, count in re.findall(pattern, text)]
    total = classes[-1][1]
    return {f"p{part}_s": next(end for end, count in classes if count >= part / 100 * total) for part in (50, 95, 99)}


def started(command, **options):
    """A program that serves metrics, and how they are read."""
    live = subprocess.Popen([*command, "--metrics", "127.0.0.1:0"], stderr=subprocess.PIPE, text=True, **options)
    for line in live.stderr:
        if address := re.search(r"http://\S+/metrics", line):
            return live, lambda: urllib.request.urlopen(address[0]).read().decode()
    sys.exit("dtd ended")


def processor_s(pid):
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main():
    dtd, run, seconds, *videos = sys.argv[1:]
    server, addresses = serve(dict(video.split("=", 1) for video in videos))
    lines = Path(os.environ.get("LINES_TO", "/dev/null")).open("w")
    live, metrics = started([dtd, "estimate", run, *addresses], stdout=lines)
    time.sleep(5)
    used, began = processor_s(live.pid), time.monotonic()
    time.sleep(float(seconds))
    share = (processor_s(live.pid) - used) / (time.monotonic() - began) / os.cpu_count()
    memory_kb = int(re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{live.pid}/status").read_text())[1])
    text = metrics()
    began = time.monotonic()
    live.terminate()
    code = live.wait(10)
    stopped_s = time.monotonic() - began
    server.kill()
    fates = {}
    for view, fate, count in re.findall(r'dtd_images_total{view="([^"]+)",fate="([^"]+)"} (\d+)', text):
        if int(count):
            fates.setdefault(view, {})[fate] = int(count)
    stages = ("decode", "wait", "search", "join", "total")
    print(
        json.dumps(
            {
                "images": fates,
                "processor_share": round(share, 3),
                "cores": os.cpu_count(),
                "memory_mb": round(memory_kb / 1024),
                "latency": {stage: percentiles(text, stage) for stage in stages},
                "exit_code": code,
                "stopped_s": round(stopped_s, 2),
            },
            indent=1,
        )
    )


if __name__ == "__main__":
    main()
