#!/usr/bin/env python3
"""Checks that prose is wrapped: Markdown text and the comments of Rust and Python sources have at most 140 columns.

Exempt: tables, code blocks, headings, and lines that cannot be broken (a link or a path without a space).
"""

import pathlib
import re
import subprocess
import sys

WIDTH = 140
COMMENT = {".rs": re.compile(r"\s*//"), ".py": re.compile(r"\s*#")}


def markdown_lines(lines: list[str]):
    """The prose lines of a Markdown file with their numbers."""
    fence = False
    for number, line in enumerate(lines, 1):
        if line.lstrip().startswith("```"):
            fence = not fence
        elif not fence and not line.lstrip().startswith(("|", "#", "![")) and not line.startswith("    "):
            yield number, line


def comment_lines(lines: list[str], comment: re.Pattern[str]):
    """The comment lines of a source file with their numbers, code blocks of its documentation left out."""
    fence = False
    for number, line in enumerate(lines, 1):
        if not comment.match(line):
            fence = False
        elif line.strip(" /!#").startswith("```"):
            fence = not fence
        elif not fence and not line.strip(" /!#").startswith("|"):
            yield number, line


def too_long(line: str) -> bool:
    """Whether a line is longer than allowed and has a space at which to break it."""
    return len(line) > WIDTH and " " in line[:WIDTH].strip(" /!#-*>")


def main() -> int:
    listed = subprocess.run(["git", "ls-files", "*.md", "*.rs", "*.py"], capture_output=True, text=True, check=True)
    faults = 0
    for name in listed.stdout.split("\n"):
        path = pathlib.Path(name)
        if not name or not path.is_file():
            continue
        lines = path.read_text(encoding="utf-8").splitlines()
        prose = markdown_lines(lines) if path.suffix == ".md" else comment_lines(lines, COMMENT[path.suffix])
        for number, line in prose:
            if too_long(line):
                print(f"{name}:{number}: {len(line)} columns, expected at most {WIDTH}: wrap the text")
                faults += 1
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
