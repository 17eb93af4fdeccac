"""Test the ranks, the correlations, the table and the picture of a study."""

import csv

import numpy as np
import pytest

from defsense_fab.workflow.study.parameter_study import StudyRuns
from defsense_fab.workflow.study.run_log import RunRecord
from defsense_fab.workflow.study.study_file import load_study

LATIN_HYPERCUBE = (
    'design = "latin-hypercube"\ncount = 60\n[parameters]\n'
    "a.x = { uniform = [-1, 1] }\na.y = { uniform = [0, 2] }\n"
    "a.nothing = { log_uniform = [1, 100] }\na.kind = ['p', 'q']"
)


def make_runs(folder, error, failed=()):
    """Return the runs of a study whose error is a function of its parameters."""
    (folder / "study.toml").write_text(LATIN_HYPERCUBE)
    study = load_study(folder)
    rows = []
    for n, point in enumerate(study.points()):
        measures = {"error": error(point), "parts": n % 3, "decoder": "affine"}
        result = ("refused", f"no room for {n % 2}", {}) if n in failed else ("done", "", measures)
        rows.append(RunRecord(f"{n:016x}", point, *result))
    return StudyRuns(study, tuple(rows))


def test_correlations_are_sorted_by_their_effect(tmp_path):
    rng = np.random.default_rng(1)
    runs = make_runs(tmp_path, lambda p: p["a.x"] - 2 * p["a.y"] + 0.1 * rng.random())
    assert list(runs.correlations) == ["a.y", "a.x", "a.nothing"]
    assert runs.correlations["a.y"] < -0.7
    assert runs.correlations["a.x"] > 0.3
    assert make_runs(tmp_path, lambda p: 1.0).correlations == {}


def test_runs_are_ranked_and_failures_are_grouped(tmp_path):
    runs = make_runs(tmp_path, lambda p: p["a.y"], failed={0, 5, 7})
    assert len(runs.done) == 57
    errors = [r.measures["error"] for r in runs.done]
    assert errors == sorted(errors)
    assert {text: len(rows) for text, rows in runs.failures.items()} == {
        "no room for 1": 2,
        "no room for 0": 1,
    }


def test_table_is_read_back(tmp_path):
    runs = make_runs(tmp_path, lambda p: p["a.y"], failed={0, 5})
    runs.write_table(tmp_path / "results.csv")
    with (tmp_path / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [r["outcome"] for r in rows].count("refused") == 2
    assert [float(r["error"]) for r in rows[1:5]] == [r.measures["error"] for r in runs.rows[1:5]]
    assert [float(r["a.x"]) for r in rows] == [r.parameters["a.x"] for r in runs.rows]


@pytest.mark.parametrize("failed", [{0, 5}, set(range(60))])
def test_picture_is_drawn(tmp_path, failed):
    make_runs(tmp_path, lambda p: p["a.y"] + 0.1, failed).draw(tmp_path / "study.png")
    assert (tmp_path / "study.png").stat().st_size > 3000
