"""The commit and the versions of the program that made a result. As a program, it adds them to a JSON on its way to docs/results.

Usage: made_by.py RUN CORPUS FILE.json > RESULT.json; RUN judged CORPUS, and FILE.json is, for instance, its metrics.json.
"""

import json
import subprocess
import sys
from pathlib import Path


def made_by(run, corpus):
    """Commit of this folder, and versions of a run and of a corpus's detections, named as in result_tables.py."""
    commit = ["git", "rev-parse", "HEAD"]
    commit = subprocess.run(commit, cwd=Path(__file__).parent, stdout=subprocess.PIPE, text=True, check=True).stdout.strip()
    summary = json.loads((Path(run) / "run.json").read_text())
    record = next(Path(corpus).glob(f"scenarios/*/detections/{summary['model_hash']}.json"), None)
    if record is None:
        sys.exit(f"{corpus} has no detections of the model that {run} was trained on: run `dtd detect`")
    record = json.loads(record.read_text())
    of_detections = {"tracking": record["tracking"], **{part: record[part]["method"] for part in ("health", "registration")}}
    return {"commit": commit, "versions": {"run": summary["format"], **of_detections}}


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    run, corpus, file = map(Path, sys.argv[1:])
    print(json.dumps({**made_by(run, corpus), **json.loads(file.read_text())}, indent=1))
