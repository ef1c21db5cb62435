#!/usr/bin/env python3
"""Checks how the modules of every crate depend on each other, by their imports with re-exports followed, and how its files are laid out.

- Modules form circles of three at most: a type and the code that checks it.
- A room is a module at the root of a crate with everything inside it. Rooms do not depend on each other in a circle, so that a reader can
  take them one after the other.
- A folder has a dozen modules at most, and is at most three levels below `src`.
- No file only lists two others.

Tests are not counted. With --list, every dependency between rooms is printed.
"""

import argparse
import re
import sys
from pathlib import Path

MAX_IN_CIRCLE = 3
# Crates whose rooms still form circles.
ROOMS_IN_CIRCLES = {
    "crates/exporter",
    "crates/flight-model",
    "crates/store",
    "crates/viewer",
    "detector-training",
    "generator",
    "labeller",
    "live",
    "xplane-bridge",
}

MAX_DEPTH = 3
MAX_MODULES = 12
# Folders with one file for each of the things that users can name.
LONG_LISTS = {"src/verbs", "crates/testkit/src"}

MODULE = re.compile(r"^\s*(?:pub(?:\([a-z]+\))? )?mod (\w+);", re.M)
USE = re.compile(r"^\s*(pub(?:\([a-z]+\))? )?use ([^;]+);", re.M)
PATH = re.compile(r"\b((?:crate|super|self)(?:::\w+)+)")


def without_tests(text):
    """The code without comments and without what only tests compile."""
    text = re.sub(r"^\s*//.*$", "", text, flags=re.M)
    text = re.sub(r"#\[cfg\(test\)\]\s*mod \w+;", "", text)
    inner = text.find("#[cfg(test)]\nmod tests {")
    return text if inner < 0 else text[:inner]


def leaves(tree):
    """The single paths of a `use`, e.g. `a::b` and `a::c` of `a::{b, c}`."""
    tree = tree.strip()
    opening = tree.find("{")
    if opening < 0:
        return [re.sub(r"\s+as \w+$", "", tree)]
    parts, depth, part = [], 0, ""
    for letter in tree[opening + 1 : tree.rfind("}")]:
        depth += (letter == "{") - (letter == "}")
        if letter == "," and depth == 0:
            parts.append(part)
            part = ""
        else:
            part += letter
    return [tree[:opening] + leaf for part in [*parts, part] if part.strip() for leaf in leaves(part)]


class Crate:
    """The modules of a crate and what each imports."""

    def __init__(self, folder):
        self.code = {}
        self.read((), folder / "src" / "lib.rs", folder / "src")
        self.exported = {module: self.exports_of(module) for module in self.code}
        self.imports = {module: self.imports_of(module) for module in self.code}

    def read(self, module, file, children):
        text = without_tests(file.read_text())
        self.code[module] = text
        for name in MODULE.findall(text):
            self.read((*module, name), children / f"{name}.rs", children / name)

    def absolute(self, module, path):
        """A path from the root of the crate; None for one of another crate."""
        parts = path.split("::")
        if parts[0] == "crate":
            return tuple(parts[1:])
        while parts[0] == "super":
            module, parts = module[:-1], parts[1:]
        if parts[0] == "self":
            return (*module, *parts[1:])
        if path.startswith("super") or (*module, parts[0]) in self.code:
            return (*module, *parts)
        return None

    def exports_of(self, module):
        paths = [leaf for visible, tree in USE.findall(self.code[module]) if visible for leaf in leaves(tree)]
        targets = [self.absolute(module, path) for path in paths]
        return {target[-1]: target for target in targets if target}

    def owner(self, path):
        """The module that has what the path names."""
        for length in range(len(path), -1, -1):
            module, rest = path[:length], path[length:]
            if module in self.code:
                target = self.exported[module].get(rest[0]) if rest else None
                return self.owner((*target, *rest[1:])) if target else module
        raise AssertionError("the root is a module")

    def imports_of(self, module):
        text = self.code[module]
        paths = [leaf for visible, tree in USE.findall(text) if not visible for leaf in leaves(tree)]
        paths += PATH.findall(USE.sub("", text))
        found = (self.absolute(module, path) for path in paths)
        return {self.owner(path) for path in found if path is not None} - {module}


def circles(graph):
    """The strongly connected components, those that others depend on first (Tarjan)."""
    index, low, stack, found = {}, {}, [], []

    def visit(node):
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in graph[node]:
            if other not in index:
                visit(other)
            if other in stack:
                low[node] = min(low[node], low[other])
        if low[node] == index[node]:
            at = stack.index(node)
            found.append(stack[at:])
            del stack[at:]

    for node in graph:
        if node not in index:
            visit(node)
    return found


def rooms_of(imports):
    """The graph of rooms; the root of the crate, which only declares them, is none."""
    graph = {module[:1]: set() for module in imports if module}
    for module, others in imports.items():
        if module:
            graph[module[:1]] |= {other[:1] for other in others if other} - {module[:1]}
    return graph


def faults_of_layout(root, source):
    """Folders with more modules than a reader can keep in mind or too far down, and files that only list others."""
    for folder in [source, *(path for path in source.rglob("*") if path.is_dir() and path.name != "tests")]:
        modules = {path.stem for path in folder.iterdir() if path.suffix == ".rs"} - {"lib", "main", "tests"}
        name = folder.relative_to(root).as_posix()
        if len(modules) > MAX_MODULES and name not in LONG_LISTS:
            yield f"{name}: {len(modules)} modules in a folder, expected at most {MAX_MODULES}"
        depth = len(folder.relative_to(source).parts)
        if depth > MAX_DEPTH:
            yield f"{name}: {depth} levels below {source.relative_to(root).as_posix()}, expected at most {MAX_DEPTH}"
    for file in source.rglob("*.rs"):
        if file.stem == "lib":
            continue
        text = without_tests(file.read_text())
        listed = len(MODULE.findall(text))
        if 0 < listed <= 2 and not re.sub(r"#!?\[[^\]]*\]", "", USE.sub("", MODULE.sub("", text))).strip():
            yield f"{file.relative_to(root).as_posix()}: only lists {listed} modules; put its content into one of them"


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--list", action="store_true", help="print which rooms each room imports")
    listed = arguments.parse_args().list
    root = Path(__file__).parent.parent
    faults = list(faults_of_layout(root, root / "src"))
    for library in sorted([*root.glob("*/src/lib.rs"), *root.glob("crates/*/src/lib.rs")]):
        folder = library.parent.parent
        crate = folder.relative_to(root).as_posix()
        faults += faults_of_layout(root, library.parent)
        imports = Crate(folder).imports
        rooms = rooms_of(imports)
        if crate not in ROOMS_IN_CIRCLES:
            for circle in circles(rooms):
                if len(circle) > 1:
                    faults.append(f"{crate}: rooms in a circle: {', '.join('::'.join(room) for room in circle)}")
        for circle in circles(imports):
            if len(circle) > MAX_IN_CIRCLE:
                names = ", ".join("::".join(module) or "lib" for module in circle)
                faults.append(f"{crate}: {len(circle)} modules in a circle, expected at most {MAX_IN_CIRCLE}: {names}")
        print(f"{crate}: {len(rooms)} rooms, at most {max(map(len, circles(imports)))} modules in a circle")
        if listed:
            for room, others in sorted(rooms.items()):
                print(f"  {'::'.join(room)}: {', '.join(sorted('::'.join(other) for other in others)) or '-'}")
    for fault in faults:
        print(fault, file=sys.stderr)
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
