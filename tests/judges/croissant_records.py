"""The croissant.json of folders as mlcroissant sees it: valid, with all its records; every listed file has the size and hash that it says.

Usage: python croissant_records.py FOLDER...     prints JSON: for each folder warnings, records by set, number of files by set
"""

import hashlib
import json
import logging
import os
import sys
import tempfile
from pathlib import Path

cache = tempfile.TemporaryDirectory()
os.environ["CROISSANT_CACHE"] = cache.name

import mlcroissant as mlc  # noqa: E402

logging.disable(logging.WARNING)


def plain(value):
    if isinstance(value, bytes):
        return value.decode()
    return value.tolist() if hasattr(value, "tolist") else value


def described_in(folder):
    text = json.loads((folder / "croissant.json").read_text())
    files = {}
    for entry in text["distribution"]:
        if entry["@type"] == "cr:FileObject":
            content = (folder / entry["contentUrl"]).read_bytes()
            assert entry["sha256"] == hashlib.sha256(content).hexdigest(), entry
            assert entry["contentSize"] == f"{len(content)} B", entry
        elif "containedIn" not in entry:
            globs = [entry["includes"]] if isinstance(entry["includes"], str) else entry["includes"]
            files[entry["@id"]] = sum(len(list(folder.glob(pattern))) for pattern in globs)
            assert files[entry["@id"]], f"no file is in {entry}"

    dataset = mlc.Dataset(jsonld=str(folder / "croissant.json"))
    issues = dataset.metadata.ctx.issues
    assert not issues.errors, issues.report()

    records = {}
    for described in text["recordSet"]:
        name = described["name"]
        rows = [{key.split("/")[-1]: plain(value) for key, value in row.items()} for row in dataset.records(name)]
        assert rows, f"{name} has no record"
        records[name] = rows
    return {"warnings": sorted(issues.warnings), "records": records, "files": files}


print(json.dumps([described_in(Path(folder)) for folder in sys.argv[1:]]))
