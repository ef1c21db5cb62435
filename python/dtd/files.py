"""The files of a corpus as they are at this moment, also while `dtd` replaces some of them."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import polars as pl
from blake3 import blake3

NEW = ".new"


class CorpusError(Exception):
    """A folder is no corpus, or a file in it is missing, damaged, a link, or not what its record says."""


def damaged(path: Path, error: object) -> CorpusError:
    """The error for a file that cannot be read: which, why, and what to do."""
    return CorpusError(f"{path} cannot be read: {error}; `dtd verify` lists what is damaged")


def read_json(path: Path) -> Any:
    """The content of a JSON file."""
    refuse_link(path)
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CorpusError(f"{path} is missing") from None
    except ValueError as error:
        raise CorpusError(f"{path} is not JSON: {error}") from None
    except OSError as error:
        raise damaged(path, error) from None


def sealed(scenario: Path, name: str) -> Path:
    """The current path of a sealed file of a scenario.

    While `dtd` replaces files, `DONE.json.new` is the seal, and a file that is still to be renamed has the suffix `.new`.
    """
    renamed = scenario / name
    new = scenario / (name + NEW)
    for path in (scenario, renamed.parent, renamed, new):
        refuse_link(path)
    if (scenario / f"DONE.json{NEW}").exists() and new.exists():
        return new
    return renamed


def sealed_table(scenario: Path, name: str) -> Path:
    """The current path of a sealed table of a scenario; checks the content."""
    # `dtd` may replace it between a look at the manifest and one at the file.
    for _ in range(3):
        path = sealed(scenario, name)
        try:
            found = blake3(path.read_bytes()).hexdigest()
        except FileNotFoundError:
            continue
        except OSError as error:
            raise damaged(path, error) from None
        if found == _hashes(scenario).get(name):
            return path
    if not path.exists():
        raise CorpusError(f"{path} is missing; `dtd verify` lists what else is")
    raise damaged(path, "it is not what MANIFEST.b3 says")


def is_sealed(scenario: Path, name: str) -> bool:
    """Whether the manifest of a scenario lists a file."""
    return name in _hashes(scenario)


def _hashes(scenario: Path) -> dict[str, str]:
    """The hash of each file that the manifest of a scenario lists."""
    manifest = sealed(scenario, "MANIFEST.b3")
    try:
        lines = manifest.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        raise CorpusError(f"{manifest} is missing") from None
    except (OSError, UnicodeDecodeError) as error:
        raise damaged(manifest, error) from None
    return {name: blake3_hash for blake3_hash, _, name in (line.partition("  ") for line in lines)}


def scan(path: Path) -> pl.LazyFrame:
    """A table, of which only the schema is read."""
    if not path.exists():
        raise CorpusError(f"{path} is missing; `dtd verify` lists what else is")
    table = pl.scan_parquet(path, glob=False)
    try:
        table.collect_schema()
    except (pl.exceptions.PolarsError, OSError) as error:
        raise damaged(path, error) from error
    return table


def collect(tables: Iterable[tuple[Path, pl.LazyFrame]]) -> list[pl.DataFrame]:
    """The content of tables with the files that they come from, read at the same time."""
    tables = list(tables)
    try:
        return pl.collect_all([table for _, table in tables])
    except (pl.exceptions.PolarsError, OSError):
        # The error does not say which.
        for path, table in tables:
            try:
                table.collect()
            except (pl.exceptions.PolarsError, OSError) as error:
                raise damaged(path, error) from error
        raise


def recorded(table: Path, blake3_hash: str) -> Path:
    """The current path of a table whose record names its hash; checks the content."""
    for path in (table.parent, table, table.with_name(table.name + NEW)):
        refuse_link(path)
    for path in (table, table.with_name(table.name + NEW)):
        try:
            found = blake3(path.read_bytes()).hexdigest()
        except FileNotFoundError:
            continue
        if found == blake3_hash:
            return path
    raise CorpusError(f"{table} is missing or is not what its record says; run `dtd detect` on the corpus again")


def refuse_link(path: Path) -> None:
    """Rejects a link, which could lead out of the corpus."""
    if path.is_symlink():
        raise CorpusError(f"{path} is a symbolic link; a corpus has none")
