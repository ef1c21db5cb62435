#!/usr/bin/env python3
"""Checks how the modules of the large crates depend on each other, by their imports with re-exports followed.

A room is a module at the root of a crate with everything inside it. Rooms must not depend on each other in a circle, and the longest chain
of rooms has a limit, so that a reader can take them one after the other. Modules inside a room may form small circles (a type and the code
that checks it). In every crate, a folder has a dozen modules at most. Tests are not counted. With --list, every dependency between rooms
is printed.
"""

import argparse
import re
import sys
from pathlib import Path

# For each crate: modules whose children are rooms, the most modules in a circle, and the most levels of rooms.
CRATES = {
    "trainer": ({"estimators"}, 3, 9),
    "crates/dataset": (set(), 6, 9),
}

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


def levels(graph):
    """The longest chain, counted in circles."""
    level = {}
    for circle in circles(graph):
        below = {level[other] for node in circle for other in graph[node] if other not in circle}
        level.update(dict.fromkeys(circle, 1 + max(below, default=0)))
    return max(level.values())


def rooms_of(imports, divided):
    """The graph of rooms; the root of the crate, which only declares them, is none."""

    def room(module):
        return module[:2] if module and module[0] in divided else module[:1]

    graph = {room(module): set() for module in imports if room(module)}
    for module, others in imports.items():
        if room(module):
            graph[room(module)] |= {room(other) for other in others if room(other)} - {room(module)}
    return graph


def long_folders(root):
    """Folders of source files with more modules than a reader can keep in mind, and how many they have."""
    for source in [root / "src", *root.glob("*/src"), *root.glob("crates/*/src")]:
        for folder in [source, *(path for path in source.rglob("*") if path.is_dir())]:
            modules = {path.stem for path in folder.iterdir() if path.suffix == ".rs"} - {"lib", "main", "tests"}
            name = folder.relative_to(root).as_posix()
            if len(modules) > MAX_MODULES and name not in LONG_LISTS:
                yield name, len(modules)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--list", action="store_true", help="print which rooms each room imports")
    listed = arguments.parse_args().list
    root = Path(__file__).parent.parent
    faults = [f"{folder}: {count} modules in a folder, expected at most {MAX_MODULES}" for folder, count in long_folders(root)]
    for crate, (divided, most_in_circle, most_levels) in CRATES.items():
        imports = Crate(root / crate).imports
        rooms = rooms_of(imports, divided)
        for circle in circles(rooms):
            if len(circle) > 1:
                faults.append(f"{crate}: rooms in a circle: {', '.join('::'.join(room) for room in circle)}")
        largest = max(circles(imports), key=len)
        if len(largest) > most_in_circle:
            names = ", ".join("::".join(module) or "lib" for module in largest)
            faults.append(f"{crate}: {len(largest)} modules in a circle, expected at most {most_in_circle}: {names}")
        high = levels(rooms)
        if high > most_levels:
            faults.append(f"{crate}: {high} levels of rooms, expected at most {most_levels}")
        print(f"{crate}: {len(rooms)} rooms on {high} levels, at most {len(largest)} modules in a circle")
        if listed:
            for room, others in sorted(rooms.items()):
                print(f"  {'::'.join(room)}: {', '.join(sorted('::'.join(other) for other in others)) or '-'}")
    for fault in faults:
        print(fault, file=sys.stderr)
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
