"""Feeds for the judges of `dtd estimate`, made with ffmpeg from the videos of a corpus."""

import json
import subprocess
from pathlib import Path

# As the corpus was encoded, so that the pieces have the same parameter sets and can be joined without encoding.
AS_RECORDED = "-c:v libx264 -preset {preset} -crf {crf} -tune zerolatency -x264-params deadzone-inter=0:deadzone-intra=0 -g 60 -bf 0 -threads 1"
NOISY = "-c:v libx264 -preset ultrafast -crf 26 -tune zerolatency -g 60 -bf 0 -threads 1"
NOISE = ",noise=alls=4:allf=t"
COLOURS = "-pix_fmt yuv420p -color_range pc -colorspace bt709 -color_primaries bt709 -color_trc bt709 -video_track_timescale 90000"


def ffmpeg(*arguments):
    subprocess.run(["nice", "-n", "19", "ffmpeg", "-v", "error", "-y", *map(str, arguments)], check=True)


def as_recorded(corpus):
    plan = json.loads((corpus / "plan.json").read_text())
    video = plan.get("common", {}).get("video") or plan["scenarios"][0]["video"]
    return AS_RECORDED.format(**video)


def rate_and_ticks(scenario):
    record = json.loads((scenario / "scenario.json").read_text())
    rate = record["frame_rate"]
    return rate["numerator"] / rate["denominator"], record["ticks"]


def still(video, rate, seconds, encoder, path, noise=""):
    """The last image of a video, for so many seconds."""
    frames = round(rate * seconds)
    looped = f"trim=end_frame=1,loop=loop={frames - 1}:size=1,setpts=N/{rate}/TB{noise}"
    ffmpeg("-sseof", -0.9 / rate, "-i", video, "-vf", looped, "-r", rate, *encoder.split(), *COLOURS.split(), path)


def join(pieces, path):
    playlist = path.with_suffix(".txt")
    playlist.write_text("".join(f"file '{piece.resolve()}'\nduration {seconds}\n" for piece, seconds in pieces))
    ffmpeg("-f", "concat", "-safe", "0", "-i", playlist, "-c", "copy", "-video_track_timescale", 90000, path)


def sources(addresses):
    """Options for an address of each view."""
    return [part for view, address in addresses.items() for part in ("--view", f"{view}={address}")]


def serve(videos, *more):
    """Starts rtsp_server.py, and returns its process and the options for its addresses."""
    script = Path(__file__).with_name("rtsp_server.py")
    command = ["/usr/bin/python3", script, *(f"{view}={path}" for view, path in videos.items()), *more]
    server = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    port = int(server.stdout.readline())
    return server, sources({view: f"rtsp://127.0.0.1:{port}/{view}" for view in videos})
