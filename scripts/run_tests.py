#!/usr/bin/env python3
"""Builds all tests in the release profile and runs their programs, four at a time.

`cargo test` runs one program after the other, although they mostly wait, for simulators, kills and timeouts: together they take half an
hour of processor time in more than an hour. The output of a program is printed when it ends, and one failure does not hide the others. A
program that hangs is killed, so that its output shows where. What failed runs once more by itself, because some tests wait for a simulator
with deadlines that a busy machine misses; what passes only then is named at the end.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor, as_completed

CARGO_TEST = ["cargo", "test", "--release", "--locked", "--workspace"]
AT_ONCE = 4
# The longest program took 890 s on two busy cores.
HANGS_AFTER_S = 1_500
# Those with limits in real time: they run beside the others, which yield the processor to them.
IN_REAL_TIME = ["estimate", "blocks", "restarts", "covers", "doctor", "view"]
# Those that take longest begin first, so that none of them is left alone at the end.
LONGEST = ["races", "awkward", "chain", "paper", "export", "profile", "object_store", "disk_faults", "memory", "verify_small"]


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


def passes(name, command, folder):
    """Runs a program and prints its output when it ends."""
    began = time.monotonic()
    with tempfile.TemporaryFile() as output:
        program = subprocess.Popen(
            command, cwd=folder, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT
        )
        watchdog = threading.Timer(HANGS_AFTER_S, program.kill)
        watchdog.start()
        _, status, spent = os.wait4(program.pid, 0)
        watchdog.cancel()
        program.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        printed = output.read().decode(errors="replace")
    place, took_s, cpu_s = os.path.relpath(folder), time.monotonic() - began, spent.ru_utime + spent.ru_stime
    verdict = "passed" if program.returncode == 0 else "FAILED: hangs" if took_s > HANGS_AFTER_S else f"FAILED ({program.returncode})"
    print(f"\n== {name} in {place}: {verdict} in {took_s:.0f} s ({cpu_s:.0f} s of processor time)\n{printed}", flush=True)
    return program.returncode == 0


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    jobs = [(name, [program] if name in IN_REAL_TIME else ["nice", "-n", "15", program], folder) for name, program, folder in programs()]
    order = [*IN_REAL_TIME, *LONGEST]
    jobs.sort(key=lambda job: order.index(job[0]) if job[0] in order else len(order))
    jobs.append(("documentation", [*CARGO_TEST, "--doc"], "."))
    began, failed = time.monotonic(), []
    with tempfile.TemporaryDirectory() as shared:
        # For corpora that several programs need (testkit::MadeOnce).
        os.environ["DTD_TEST_SHARED"] = shared
        with ThreadPoolExecutor(AT_ONCE) as pool:
            running = {pool.submit(passes, *job): job for job in jobs}
            for ended in as_completed(running):
                if not ended.result():
                    failed.append(running[ended])
        broken = [job for job in failed if not passes(*job)]
    for job in failed:
        print(f"\n== {job[0]} {'FAILED twice' if job in broken else 'failed beside others and passed alone'}")
    print(f"\n{len(jobs)} test programs in {time.monotonic() - began:.0f} s, {len(broken)} failed")
    sys.exit(1 if broken else 0)


if __name__ == "__main__":
    main()
