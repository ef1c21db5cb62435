#!/usr/bin/env python3
"""Builds all tests in the release profile and runs their programs, four at a time.

`cargo test` runs one program after the other, although they mostly wait, for simulators, kills and timeouts: all of them together took
10 minutes of processor time in 21 minutes. The output of a program is printed when it ends, that of one that failed once more at the end;
one failure does not hide the others.
"""

import json
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor, as_completed

CARGO_TEST = ["cargo", "test", "--release", "--locked", "--workspace"]
AT_ONCE = 4
# Those that take longest begin first, so that none of them is left alone at the end.
LONGEST = ["awkward", "races", "chain", "mutations", "object_store", "plugin", "limits"]


def programs():
    """Name, program and folder of each, after building them."""
    build = subprocess.Popen(
        [*CARGO_TEST, "--no-run", "--message-format=json-render-diagnostics"], stdout=subprocess.PIPE, text=True
    )
    found = []
    for line in build.stdout:
        message = json.loads(line)
        if message.get("reason") == "compiler-artifact" and message["profile"]["test"] and message["executable"]:
            found.append((message["target"]["name"], message["executable"], os.path.dirname(message["manifest_path"])))
    if build.wait() != 0:
        sys.exit(build.returncode)
    return found


def run(command, folder):
    """Exit status, seconds and output."""
    began = time.monotonic()
    ended = subprocess.run(
        command, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    return ended.returncode, time.monotonic() - began, ended.stdout.decode(errors="replace")


def main():
    jobs = [(name, [program], folder) for name, program, folder in programs()]
    jobs.sort(key=lambda job: LONGEST.index(job[0]) if job[0] in LONGEST else len(LONGEST))
    jobs.append(("documentation", [*CARGO_TEST, "--doc"], "."))
    began, failed = time.monotonic(), []
    with ThreadPoolExecutor(AT_ONCE) as pool:
        running = {pool.submit(run, command, folder): (name, folder) for name, command, folder in jobs}
        for ended in as_completed(running):
            name, folder = running[ended]
            status, seconds, output = ended.result()
            title = f"{name} in {os.path.relpath(folder)}: {'passed' if status == 0 else f'FAILED ({status})'} in {seconds:.0f} s"
            print(f"\n== {title}\n{output}", flush=True)
            if status != 0:
                failed.append((title, output))
    for title, output in failed:
        print(f"\n== {title}\n{output}", flush=True)
    print(f"\n{len(jobs)} test programs in {time.monotonic() - began:.0f} s, {len(failed)} failed")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
