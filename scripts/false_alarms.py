"""Counts alarms about cameras (dataset.md, health) in corpora whose cameras have no fault. Prints JSON.

Usage: false_alarms.py CORPUS ..; the corpora are searched already. Needs pyarrow and numpy.
"""

import json
import sys
from pathlib import Path

import not_ideal_figures as figures

if len(sys.argv) < 2:
    sys.exit(__doc__)
found = figures.of_clean(map(Path, sys.argv[1:]))
if not found["views"]:
    sys.exit("no health tables: search the corpora first (dtd detect)")
print(json.dumps(found, indent=1))
