"""Judges a run where the world is not ideal, row by row, and writes one JSON with what each row showed.

Usage: not_ideal.py RUN DEMO OUT [ROW ..]; without rows all of them. RUN: of `dtd train`; DEMO: the corpus of `dtd demo`, for the rows whose
calibration is wrong. ONLY: see disturbed-corpora.sh. Needs pyarrow, PyAV and b3sum, and the program as $DTD (default target/release/dtd).
Rows that OUT has already are not made again. OUT/not-ideal.json holds all finished rows.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import not_ideal_figures as figures
from made_by import made_by

HERE = Path(__file__).parent
DTD = Path(os.environ.get("DTD", HERE.parent / "target/release/dtd")).resolve()
os.environ["DTD"] = str(DTD)
# Recorded by disturbed-corpora.sh.
RECORDED = [
    "untouched",
    "late-490ms",
    "late-450ms",
    "late-200ms",
    "shake-2px",
    "frozen-4pct",
    "turned-0.3deg",
    "tilt-2arcsec",
    "tilt-5arcsec",
    "tower-camera",
    "step-down",
    "continuous-descent",
]
# Composed by compose_boxes.py from the untouched corpus.
COMPOSED = ["still", "moving", "replaced", "missing", "arrival-behind", "arrival-ahead", "one-view-arrival"]
# Trained on such a corpus, and judged on its test side.
TRAINED = {f"trained-{name}": name for name in ("untouched", "tilt-2arcsec", "tilt-5arcsec", "tower-camera")}
# Yaw, pitch and roll, degrees; focal length, percent; move to the north, metres.
MISCALIBRATED = {
    "calibration-true": [0, 0, 0, 0, 0],
    "calibration-yaw": [0.2, 0, 0, 0, 0],
    "calibration-pitch": [0, 0.1, 0, 0, 0],
    "calibration-all": [0.5, 0.2, 1, 3, 5],
}
# Networks are not judged, so they are hardly trained.
STEPS = 'ends = "steps", optimisation = { steps = 50, batch_size = 64, learning_rate = 1e-3 }'
CONFIG = f"""calibration = {{ hidden = [8], features = 8, head_hidden = [8], min_steps = 10, {STEPS} }}
estimator = {{ lstm = [8], head_hidden = [8], {STEPS} }}
mono = {{ hidden = [8], {STEPS} }}
"""
ROWS = [*RECORDED, *COMPOSED, *TRAINED, *MISCALIBRATED, "lamps"]


def dtd(*arguments):
    """Runs the program; its losses (exit 3) are no failure."""
    done = subprocess.run([DTD, *map(str, arguments)], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode not in (0, 3):
        sys.exit(f"dtd {' '.join(map(str, arguments))}: exit {done.returncode}")
    return done.stdout


def fresh(folder):
    """The folder, without what an interrupted call left of it."""
    shutil.rmtree(folder, ignore_errors=True)
    return folder


def train(corpus, run, *settings):
    """A run and its evaluation."""
    config = run.parent / "not-ideal.toml"
    config.write_text(CONFIG)
    dtd("train", corpus, "--out", fresh(run), "--config", config, *settings)
    dtd("evaluate", run, "--corpus", corpus)
    return {**made_by(run, corpus), **figures.of_judged(run)}


def recorded(run, out, row):
    """A corpus of disturbed-corpora.sh, judged and verified."""
    subprocess.run(["bash", HERE / "disturbed-corpora.sh", out, "untouched", row], check=True)
    judged = fresh(out / "judged" / row)
    dtd("evaluate", run, "--corpus", out / row, "--side", "all", "--out", judged)
    found = subprocess.run([DTD, "verify", out / row, "--json"], stdout=subprocess.PIPE, text=True, check=False)
    return {
        **made_by(run, out / row),
        **figures.of_judged(judged),
        "health": figures.of_health(out / row, out / "untouched", judged, row),
        "verify": figures.of_verify(json.loads(found.stdout)),
    }


def composed(run, out, row):
    """The untouched corpus with false boxes."""
    subprocess.run(["bash", HERE / "disturbed-corpora.sh", out, "untouched"], check=True)
    fresh(out / row)
    subprocess.run([sys.executable, HERE / "compose_boxes.py", out / "untouched", out / row, row], check=True)
    judged = fresh(out / "judged" / row)
    dtd("evaluate", run, "--corpus", out / row, "--side", "all", "--out", judged)
    others = out / row / "other-arrivals.json"
    others = json.loads(others.read_text()) if others.exists() else None
    found = {**made_by(run, out / row), **figures.of_judged(judged, others)}
    shutil.rmtree(out / row)
    return found


def trained(out, row):
    """A training on a corpus of disturbed-corpora.sh."""
    subprocess.run(["bash", HERE / "disturbed-corpora.sh", out, TRAINED[row]], check=True)
    made = train(out / TRAINED[row], out / row)
    shutil.rmtree(out / row)
    return made


def lamps(out, row):
    """Lamps in rain, and far arrivals in clear air."""
    corpus = out / row
    dtd("generate", HERE.parent / "docs/results/lamps.toml", "--sim", "mock", "--out", corpus)
    dtd("label", corpus)
    dtd("detect", corpus)
    return figures.of_tracks(corpus)


def forget_registrations(corpus):
    """The same boxes, to be registered again with the calibration."""
    for path in corpus.glob("scenarios/*/detections/*.json"):
        record = json.loads(path.read_text())
        for key in ("registration", "registrations_blake3"):
            record.pop(key)
        path.write_text(json.dumps(record))


def miscalibrated(demo, out, row):
    """A training whose calibration is wrong, registered again with the cameras that it fitted."""
    corpus, first, again = out / row, out / f"{row}-first", out / f"{row}-again"
    copy = out / f"{row}-copy"
    if not corpus.exists():
        fresh(copy)
        example = DTD.parent / "examples" / "miscalibrated_corpus"
        if not example.exists():
            sys.exit(f"{example} is missing: cargo build --release --workspace --example miscalibrated_corpus")
        subprocess.run([example, demo, copy, *map(str, MISCALIBRATED[row])], check=True)
        forget_registrations(copy)
        copy.rename(corpus)
    if not (first / "evaluation.json").exists():
        dtd("detect", corpus)
        train(corpus, first)
    made = {"as_detected": figures.of_judged(first)}
    dtd("detect", corpus, "--registration-of", first)
    made["registered_again"] = train(corpus, again)
    # In one step, so that half a corpus never looks like a whole one.
    corpus.rename(fresh(copy))
    for folder in (copy, first, again):
        shutil.rmtree(folder)
    return made


def main():
    run, demo, out = (Path(argument).resolve() for argument in sys.argv[1:4])
    wanted = sys.argv[4:] or ROWS
    unknown = [row for row in wanted if row not in ROWS]
    if unknown:
        sys.exit(f"unknown row {unknown[0]}, expected {', '.join(ROWS)}")
    (out / "rows").mkdir(parents=True, exist_ok=True)
    for row in wanted:
        path = out / "rows" / f"{row}.json"
        if path.exists():
            continue
        if row in RECORDED:
            made = recorded(run, out, row)
        elif row in COMPOSED:
            made = composed(run, out, row)
        elif row in TRAINED:
            made = trained(out, row)
        elif row == "lamps":
            made = lamps(out, row)
        else:
            made = miscalibrated(demo, out, row)
        path.write_text(json.dumps(made, indent=1))
        print(f"{row}: done", flush=True)
    made = {row: out / "rows" / f"{row}.json" for row in ROWS}
    rows = {row: json.loads(path.read_text()) for row, path in made.items() if path.exists()}
    (out / "not-ideal.json").write_text(json.dumps(figures.beside_untouched(rows), indent=1) + "\n")


if __name__ == "__main__":
    main()
