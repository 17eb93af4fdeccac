"""The tables of the Cords mode, computed from given numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.optimization.limits.verification import (
    CordCheck,
    LayoutCheck,
    LimitViolation,
)
from defsense_fab.studio.cords.cord_results import (
    broken_cords,
    comparison_table,
    error_table,
    limits_table,
    signal_bars,
)
from defsense_fab.workflow.design.layout_judge import CordComparison, JudgedLayout

POSE_ERRORS = {"bend": 2.0, "twist": 1.0}


def judged(error):
    signals = {"bend": np.array([0.1, -0.2]), "twist": np.array([0.0, 0.05])}
    return JudgedLayout(error, "quadratic", POSE_ERRORS, signals, np.zeros((5, 2)))


def test_error_table_has_a_row_for_each_pose():
    lines = error_table(judged(1.234), None).splitlines()
    assert lines[0] == "### 1.23 mm"
    assert "quadratic" in lines[1]
    assert lines[-2:] == ["| bend | 2.00 | █████████ |", "| twist | 1.00 | ████ |"]


def test_error_table_shows_the_error_after_training_if_it_is_known():
    assert "2.50 mm" in error_table(replace(judged(1.0), trained=2.5), None)
    assert error_table(judged(1.0), None).count("mm") == 2


def test_signal_bars_have_one_scale_for_all_poses():
    page = signal_bars(judged(1.0), ["a", "<b>"], "a")
    assert page.count("background:#1f77b4") == 3
    assert page.count("background:#e67814") == 1
    assert page.count("width:50.0%") == 1  # only the largest signal fills its half
    assert "&lt;b&gt;" in page
    assert signal_bars(judged(1.0), [], None) == ""


def test_names_are_escaped_in_tables():
    prediction = JudgedLayout(1.0, "affine", {"a|<b>": 1.0}, {}, np.zeros((1, 1)))
    last_line = error_table(prediction, None).splitlines()[-1]
    assert last_line.startswith("| a\\|&lt;b&gt; | 1.00 |")


def test_error_table_shows_the_change_during_a_drag():
    assert error_table(judged(1.0), judged(1.25)).startswith("### 1.00 mm (-0.25)")
    assert error_table(judged(1.0), judged(1.001)).startswith("### 1.00 mm\n")
    assert "mm" not in error_table(None, None)


def test_limits_table_lists_numbers_and_violations():
    thin = LimitViolation(
        "wall-too-thin", "cord 'b' leaves a wall of 0.40 mm", ("b",), 0.4, (0.0, 0.0, 0.0)
    )
    cords = (
        CordCheck(140.0, np.inf, 2.8, (1.0, 1.5), (), np.zeros((0, 3))),
        CordCheck(90.0, 12.0, 0.4, (1.0, np.inf), (thin,), np.ones((1, 3))),
    )
    check = LayoutCheck(cords, 5.0, (thin,), np.ones((1, 3)))
    lines = limits_table(check, ["a", "b"]).splitlines()
    assert lines[2] == "| a | 142 mm | straight | 2.8 mm |"
    assert lines[3] == "| b | 91 mm | 12 mm | 0.4 mm |"
    assert lines[-1] == f"- {thin.message}"


def test_broken_cords_come_from_the_violations_and_not_from_their_texts():
    near = LimitViolation(
        "cords-too-close", "the name of c is in this text", ("a", "b"), 1.0, (0.0, 0.0, 0.0)
    )
    check = LayoutCheck((), 1.0, (near,), np.zeros((0, 3)))
    assert broken_cords(check) == {"a", "b"}


@pytest.mark.parametrize(("correlation", "is_redundant"), [(-0.97, True), (0.94, False)])
def test_comparison_table_has_both_cords(correlation, is_redundant):
    comparison = CordComparison(("a", "b"), (1.5, None), 1.25, (0.125, 0.5), correlation)
    assert comparison.is_redundant == is_redundant
    lines = comparison_table(comparison).splitlines()
    assert lines[0].split() == ["|", "|", "a", "|", "b", "|"]
    assert "| 1.50 mm (+0.25) |" in lines[2]
    assert lines[3].endswith("| 12.5 % | 50.0 % |")
    assert f"{correlation:+.2f}" in lines[-1]
