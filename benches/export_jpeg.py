"""Processor time of `dtd export --to yolo --pictures jpeg` against PyAV and OpenCV, which decode the same videos and write JPEGs of quality 95.

    python3 benches/export_jpeg.py CORPUS [ROUNDS [PROGRAM]]        (default: 3; target/release/dtd)

Needs the packages `av` and `opencv-python-headless`. One thread for OpenCV, since processor time is compared. Rounds alternate; the best of
each counts. `dtd` also checks each file against its seal, and hashes what it writes.
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

OTHER = """
import sys, av, cv2
cv2.setNumThreads(1)
folder, *videos = sys.argv[1:]
for number, video in enumerate(videos):
    for tick, frame in enumerate(av.open(video).decode(video=0)):
        cv2.imwrite(f"{folder}/{number}_{tick:06}.jpg", frame.to_ndarray(format="bgr24"), [cv2.IMWRITE_JPEG_QUALITY, 95])
"""


def cpu_s(*command):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main():
    corpus = Path(sys.argv[1])
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 3
    dtd = sys.argv[3] if len(sys.argv) > 3 else "target/release/dtd"
    videos = sorted(corpus.glob("scenarios/*/views/*"))
    best = [float("inf")] * 2
    images = 0
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            ours, theirs = f"{folder}/ours", f"{folder}/theirs"
            os.mkdir(theirs)
            exported = cpu_s(dtd, "export", corpus, "--to", "yolo", "--pictures", "jpeg", "--out", ours)
            written = cpu_s(sys.executable, "-c", OTHER, theirs, *videos)
            best = [min(best[0], exported), min(best[1], written)]
            images = len(os.listdir(theirs))
    for name, seconds in zip(["dtd export", "PyAV, OpenCV"], best):
        print(f"{name:14} {1e3 * seconds / images:6.1f} CPU-ms per image")
    print(f"ratio          {best[0] / best[1]:6.2f}")


if __name__ == "__main__":
    main()
