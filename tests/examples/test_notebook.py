"""The notebook of the Python interface runs from top to bottom, and was kept as it ran."""

import importlib.util
import json
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "examples" / "notebook"
NOTEBOOK = FOLDER / "first-device.ipynb"


@pytest.mark.slow
def test_the_notebook_runs_and_its_figures_are_those_kept():
    spec = importlib.util.spec_from_file_location("run_cells", FOLDER / "run_cells.py")
    runner = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(runner)
    kept = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    made, names = runner.run_notebook(NOTEBOOK)
    assert NOTEBOOK.stat().st_size < 300_000
    kinds = [
        [[sorted(o.get("data", {})) for o in c.get("outputs", [])] for c in n["cells"]]
        for n in (kept, made)
    ]
    assert kinds[0] == kinds[1]
    assert json.dumps(kinds[1]).count("image/png") == 5
    assert (sorted(names["rmse"])) == names["rmse"]  # noise only harms
    assert names["model"].test_rmse < 1.0  # mm, of movements of 15 mm
