"""Pareto front, sensitivities, and the table of a study."""

import csv
import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from defsense_fab.core.errors import StudyError
from defsense_fab.workflow.study.points.study_toml import load_study
from defsense_fab.workflow.study.results import study_table
from defsense_fab.workflow.study.results.sensitivity import compute_sensitivities, compute_sobol
from defsense_fab.workflow.study.results.study_page import write_study_page
from defsense_fab.workflow.study.results.study_table import (
    StudyTable,
    check_table_owner,
    find_compromises,
    find_pareto_front,
    write_table,
)
from defsense_fab.workflow.study.runs.planning import design_points
from defsense_fab.workflow.study.runs.run_log import RunRecord
from tests.support.errors import raises

LHC = (
    'design = "latin-hypercube"\ncount = 60\nrecord = ["error", "parts", "decoder"]\n[parameters]\n'
    "a.x = { uniform = [-1, 1] }\na.y = { uniform = [0, 2] }\n"
    "a.nothing = { log_uniform = [1, 100] }"
)


def make_table(folder, error, text=LHC, failed=()):
    """Return the table of a study whose error is a function of its parameters."""
    (folder / "study.toml").write_text(text)
    study = load_study(folder)
    rows = []
    for n, point in enumerate(design_points(study)):
        measures = {"error": error(point), "parts": n % 3, "decoder": "affine"}
        result = ("refused", f"no room for {n % 2}", {}) if n in failed else ("done", "", measures)
        rows.append(RunRecord(f"{n:016x}", point, *result))
    return StudyTable("bar", study, tuple(rows), len(rows), len(rows), {"numpy": "2"})


def test_pareto_front_has_the_rows_that_no_other_dominates():
    values = np.random.default_rng(1).integers(0, 6, (80, 3)).astype(float)
    for row, is_on_front in zip(values, find_pareto_front(values), strict=True):
        better = [o for o in values if (o <= row).all() and (o < row).any()]
        assert is_on_front == (not better)


def test_sobol_indices_of_a_known_function(tmp_path):
    # x^2 + y + xy/2 of x in (-1, 1), y in (0, 2): with v = y - 1, x^2 + v + x/2 + xv/2, whose
    # variances are 4/45 + 1/12 (x), 1/3 (v), 1/36 (both).
    table = make_table(tmp_path, lambda p: p["a.x"] ** 2 + p["a.y"] + p["a.x"] * p["a.y"] / 2)
    x, y, both = 4 / 45 + 1 / 12, 1 / 3, 1 / 36
    sobol = compute_sobol(table, "error")
    assert sobol.predicted > 0.999
    total = x + y + both
    assert sobol.first == pytest.approx([x / total, y / total, 0], abs=0.02)
    assert sobol.total == pytest.approx([(x + both) / total, (y + both) / total, 0], abs=0.02)


def test_sobol_indices_need_a_good_surface_and_no_failures(tmp_path):
    rng = np.random.default_rng(1)
    assert compute_sobol(make_table(tmp_path, lambda p: rng.random()), "error") is None
    assert compute_sobol(make_table(tmp_path, lambda p: p["a.x"], failed={3}), "error") is None


def test_rank_share_detects_non_monotonic_effects(tmp_path):
    rng = np.random.default_rng(1)
    table = make_table(tmp_path, lambda p: 3 * abs(p["a.x"]) - p["a.y"] + 0.1 * rng.random())
    found = {s.key: s for s in compute_sensitivities(table, "error")}
    assert abs(found["a.x"].rho) < 0.2 < 0.5 < found["a.x"].share
    assert found["a.y"].rho < -0.3
    assert found["a.y"].p_value < 0.01
    assert found["a.nothing"].share < 0.15
    text = (
        'record = ["error"]\n[parameters]\na.kind = ["p", "q", "r"]\n'
        "a.n = { range = [1, 9], step = 1 }"
    )
    table = make_table(tmp_path, lambda p: 10 * (p["a.kind"] == "q") + p["a.n"], text)
    found = compute_sensitivities(table, "error")
    assert [s.key for s in found] == ["a.kind", "a.n"]
    assert found[0].rho is None
    assert found[0].share > 0.6


def test_table_is_read_back_with_its_metadata(tmp_path, monkeypatch):
    (tmp_path / "study").mkdir()
    table = make_table(tmp_path, lambda p: p["a.y"], failed={0, 5})
    path = write_table(tmp_path, table)
    found = pq.read_table(path)
    assert found["outcome"].to_pylist().count("refused") == 2
    assert found["error"].to_pylist()[:2] == [None, table.rows[1].measures["error"]]
    assert found["a.x"].to_pylist() == [r.parameters["a.x"] for r in table.rows]
    metadata = json.loads(found.schema.metadata[b"defsense-fab study"])
    assert (metadata["device"], metadata["versions"], metadata["runs"]) == (
        "bar",
        {"numpy": "2"},
        60,
    )
    check_table_owner(tmp_path, "bar")
    with raises(StudyError, "results-of-another-device", device="bar"):
        check_table_owner(tmp_path, "blob")
    path.write_bytes(b"PAR1")
    with raises(StudyError, "not-a-study-table"):
        check_table_owner(tmp_path, "bar")
    path.unlink()
    monkeypatch.setattr(study_table, "_pyarrow", lambda: None)
    path = write_table(tmp_path, table)
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert [float(r["error"]) for r in rows[1:5]] == [r.measures["error"] for r in table.rows[1:5]]
    assert not (path.parent / "results.parquet").exists()
    check_table_owner(tmp_path, "bar")
    with raises(StudyError, "results-of-another-device", device="bar"):
        check_table_owner(tmp_path, "blob")
    path.write_text("a,b\n")
    with raises(StudyError, "not-a-study-table"):
        check_table_owner(tmp_path, "bar")


def test_page_has_best_runs_failures_and_pictures(tmp_path):
    table = make_table(tmp_path, lambda p: p["a.y"] + 0.1, failed={0, 5, 7})
    best = min(table.rows, key=lambda r: r.measures.get("error", 9))
    assert table.done[0] == best
    assert best in find_compromises(table)
    path = tmp_path / "study.html"
    write_study_page(
        path, table, find_compromises(table), compute_sensitivities(table, "error"), None
    )
    text = path.read_text("utf-8")
    assert text.count("data:image/png") == 4
    assert "no room for 1" in text
    assert text.index(best.run[:8]) < text.index("<details")
    assert "http" not in text.replace("http-equiv", "")
