#!/usr/bin/env python3
"""Prints the licences of the crates that `dtd` is linked from: name, version, licence and source, then each distinct text once."""

import json
import pathlib
import re
import subprocess
import sys

FILES = re.compile(r"(?i)(licen[cs]e|copying|notice|copyright|unlicense)")


def output_of(*command: str) -> str:
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout


def crates() -> list[dict]:
    """The packages of other authors, without those that only build scripts and procedural macros need."""
    tree = output_of("cargo", "tree", "--locked", "--edges", "normal,no-proc-macro", "--prefix", "none", "--format", "{p}")
    linked = {tuple(line.split()[:2]) for line in tree.splitlines()}
    host = re.search(r"host: (\S+)", output_of("rustc", "-vV"))[1]
    metadata = json.loads(output_of("cargo", "metadata", "--locked", "--format-version", "1", "--filter-platform", host))
    # The workspace's own crates have no source.
    return [
        crate for crate in metadata["packages"] if crate["source"] and (crate["name"], f"v{crate['version']}") in linked
    ]


def texts(crate: dict) -> list[str]:
    folder = pathlib.Path(crate["manifest_path"]).parent
    files = sorted(path for path in folder.rglob("*") if path.is_file() and FILES.match(path.name) and path.suffix != ".rs")
    return [text for file in files if (text := file.read_text(encoding="utf-8", errors="replace").strip())]


def main() -> int:
    holders: dict[str, list[str]] = {}
    print("The program contains these crates:\n")
    for crate in sorted(crates(), key=lambda crate: crate["name"]):
        name = f"{crate['name']} {crate['version']}"
        print(f"{name}: {crate['license'] or 'see its text'}, {crate['repository'] or 'no repository named'}")
        for text in texts(crate):
            holders.setdefault(text, []).append(name)
    for text, names in holders.items():
        print(f"\n{'-' * 100}\n{', '.join(dict.fromkeys(names))}:\n\n{text}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
