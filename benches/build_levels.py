"""Processor time of the verbs against a build with all dependencies at level 3: the cost of the levels in Cargo.toml.

    python3 benches/build_levels.py [ROUNDS [PROGRAM]]        (default: 3; a build of this tree at level 3)

PROGRAM is another build of `dtd`, to compare with instead. Rounds alternate; the best of each counts. Records a scenario of demo.toml, and
trains on the corpus of `dtd demo` (scripts/demo.sh) in target/demo.
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
SCENARIO = "0600-clear-r1"


def level_three():
    target = TARGET / "level-3"
    levels = [f'profile.release.package.{crate}.opt-level=3' for crate in ('"*"', "dtd")]
    build = ["cargo", "build", "--quiet", "--release", "--locked", "--target-dir", target]
    subprocess.run(build + [word for level in levels for word in ("--config", level)], cwd=ROOT, check=True)
    runtime = target / "lib"
    if not runtime.exists():
        runtime.symlink_to((TARGET / "lib").resolve())
    return target / "release/dtd"


def verbs(folder, demo):
    """Verbs with their arguments; those that write into a corpus work on a recording made before."""
    corpus = folder / "corpus"
    export = ["export", corpus, "--every", "2", "--out", folder / "out"]
    return {
        "generate": ["generate", "demo.toml", "--only", SCENARIO, "--out", corpus],
        "label": ["label", corpus],
        "detect": ["detect", corpus],
        "verify": ["verify", corpus],
        "export --to coco (PNG)": [*export, "--to", "coco"],
        "export --to yolo (JPEG)": [*export, "--to", "yolo", "--pictures", "jpeg"],
        "export --to webdataset (PNG)": [*export, "--to", "webdataset"],
        "export --to huggingface": [*export, "--to", "huggingface"],
        "train --quick": ["train", demo, "--quick", "--out", folder / "out"],
        "predict": ["predict", demo.parent / "run", "--corpus", demo, "--out", folder / "out.parquet"],
        "evaluate": ["evaluate", demo.parent / "run", "--corpus", demo, "--out", folder / "out"],
        "plan": ["plan", "scenarios.toml"],
    }


def cpu_s(program, arguments):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([program, *arguments], cwd=ROOT, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(f"{program} {' '.join(map(str, arguments))}: exit {done.returncode}\n{done.stderr}")
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main():
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    ours = TARGET / "release/dtd"
    other = Path(sys.argv[2]) if len(sys.argv) > 2 else level_three()
    demo = TARGET / "demo/corpus"
    best = {}
    for _ in range(rounds):
        for program in (ours, other):
            with tempfile.TemporaryDirectory() as folder:
                for verb, arguments in verbs(Path(folder), demo).items():
                    subprocess.run(["rm", "-rf", f"{folder}/out"], check=True)
                    measured = cpu_s(program, arguments)
                    best[verb, program] = min(measured, best.get((verb, program), measured))
    print("| verb | CPU s | other build, CPU s | ratio |\n|---|---|---|---|")
    for verb in dict.fromkeys(verb for verb, _ in best):
        print(f"| `{verb}` | {best[verb, ours]:.2f} | {best[verb, other]:.2f} | {best[verb, ours] / best[verb, other]:.2f} |")


if __name__ == "__main__":
    main()
