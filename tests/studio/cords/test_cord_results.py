"""The tables of the Cords mode, computed from given numbers."""

from __future__ import annotations

import numpy as np
import pytest

from defsense_fab.optimize.limits.verification import (
    CordCheck,
    LayoutCheck,
    LimitViolation,
)
from defsense_fab.optimize.prediction.layout_judge import JudgedLayout
from defsense_fab.studio.cords.cord_results import (
    CordComparison,
    broken_cords,
    comparison_table,
    error_table,
    limits_table,
)
from defsense_fab.studio.workbench.page_tables import full_pose_errors

PER_STATE = {"rest": 0.1, "bend@0.5": 0.8, "bend@1": 2.0, "twist@1": 1.0, "bend@1+twist@1": 9.0}


def judged(error):
    return JudgedLayout(error, "quadratic", PER_STATE, tuple(PER_STATE), np.zeros((5, 2)))


def test_error_table_shows_each_pose_at_its_extreme():
    assert full_pose_errors(PER_STATE) == {"bend": 2.0, "twist": 1.0}
    lines = error_table(judged(1.234), None).splitlines()
    assert lines[0] == "### 1.23 mm"
    assert "quadratic" in lines[1]
    assert lines[-2:] == ["| bend | 2.00 | █████████ |", "| twist | 1.00 | ████ |"]


def test_names_are_escaped_in_tables():
    prediction = JudgedLayout(1.0, "affine", {"a|<b>@1": 1.0}, ("a|<b>@1",), np.zeros((1, 1)))
    last_line = error_table(prediction, None).splitlines()[-1]
    assert last_line.startswith("| a\\|&lt;b&gt; | 1.00 |")


def test_error_table_shows_the_change_during_a_drag():
    assert error_table(judged(1.0), judged(1.25)).startswith("### 1.00 mm (-0.25)")
    assert error_table(judged(1.0), judged(1.001)).startswith("### 1.00 mm\n")
    assert "mm" not in error_table(None, None)


def test_limits_table_lists_numbers_and_violations():
    thin = LimitViolation("wall-too-thin", "cord 'b' leaves a wall of 0.40 mm", ("b",), 0.4)
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
    near = LimitViolation("cords-too-close", "the name of c is in this text", ("a", "b"), 1.0)
    check = LayoutCheck((), 1.0, (near,), np.zeros((0, 3)))
    assert broken_cords(check) == {"a", "b"}


@pytest.mark.parametrize(("correlation", "is_redundant"), [(-0.97, True), (0.94, False)])
def test_comparison_table_has_both_cords(correlation, is_redundant):
    comparison = CordComparison(("a", "b"), (1.5, None), 1.25, (0.125, 0.5), correlation)
    assert comparison.is_redundant == is_redundant
    lines = comparison_table(comparison).splitlines()
    assert lines[0] == "| | a | b |"
    assert "| 1.50 mm (+0.25) |" in lines[2]
    assert lines[3].endswith("| 12.5 % | 50.0 % |")
    assert f"{correlation:+.2f}" in lines[-1]
