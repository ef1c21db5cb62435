"""A notebook that stands in git without outputs, run cell by cell as Jupyter would, in one namespace.

Usage: python notebook.py NOTEBOOK NAME..     prints JSON: what these names hold at the end, and the number of figures drawn
"""

import contextlib
import io
import json
import os
import sys

os.environ["MPLBACKEND"] = "Agg"

import matplotlib.pyplot as plt  # noqa: E402
import nbformat  # noqa: E402

notebook = nbformat.read(sys.argv[1], as_version=4)
nbformat.validate(notebook)
cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
assert not any(cell.outputs or cell.execution_count for cell in cells), "outputs are in the file; clear them"
namespace = {}
with contextlib.redirect_stdout(io.StringIO()):
    for number, cell in enumerate(cells):
        exec(compile(cell.source, f"{sys.argv[1]}, code cell {number}", "exec"), namespace)
held = {name: getattr(namespace[name], "tolist", lambda: namespace[name])() for name in sys.argv[2:]}
print(json.dumps({"figures": len(plt.get_fignums()), "held": held}))
