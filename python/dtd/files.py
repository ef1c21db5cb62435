"""The files of a corpus as they are at this moment, also while `dtd` replaces some of them."""

import json
from pathlib import Path
from typing import Any

from blake3 import blake3

NEW = ".new"


class CorpusError(Exception):
    """A folder is no corpus, or a file in it is missing or not what its record says."""


def read_json(path: Path) -> Any:
    """The content of a JSON file."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CorpusError(f"{path} is missing") from None
    except ValueError as error:
        raise CorpusError(f"{path} is not JSON: {error}") from None


def sealed(scenario: Path, name: str) -> Path:
    """The current path of a sealed file of a scenario.

    While `dtd` replaces files, `DONE.json.new` is the seal, and a file that is still to be renamed has the suffix `.new`.
    """
    renamed = scenario / name
    new = scenario / (name + NEW)
    if (scenario / f"DONE.json{NEW}").exists() and new.exists():
        return new
    return renamed


def recorded(table: Path, blake3_hash: str) -> Path:
    """The current path of a table whose record names its hash; checks the content."""
    for path in (table, table.with_name(table.name + NEW)):
        try:
            found = blake3(path.read_bytes()).hexdigest()
        except FileNotFoundError:
            continue
        if found == blake3_hash:
            return path
    raise CorpusError(f"{table} is missing or is not what its record says; run `dtd detect` on the corpus again")
