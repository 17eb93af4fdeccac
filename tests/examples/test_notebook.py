"""The notebook of the Python interface runs, and its saved outputs are up to date."""

import importlib.util
import json

import pytest

from tests.support.places import ROOT

FOLDER = ROOT / "examples" / "notebook"
NOTEBOOK = FOLDER / "first-device.ipynb"


@pytest.mark.slow
def test_notebook_runs_and_has_the_saved_kinds_of_outputs():
    spec = importlib.util.spec_from_file_location("run_cells", FOLDER / "run_cells.py")
    runner = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(runner)
    saved = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    executed, names = runner.run_notebook(NOTEBOOK)
    assert NOTEBOOK.stat().st_size < 300_000
    kinds = [
        [[sorted(o.get("data", {})) for o in c.get("outputs", [])] for c in n["cells"]]
        for n in (saved, executed)
    ]
    assert kinds[0] == kinds[1]
    assert json.dumps(kinds[1]).count("image/png") == 5
    assert (sorted(names["rmse"])) == names["rmse"]  # noise only harms
    assert names["model"].test_rmse < 1.0  # mm, of movements of 15 mm
