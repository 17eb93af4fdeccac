"""What the page says, of numbers that are given."""

from __future__ import annotations

import numpy as np

from defsense_fab.optimize.limits.verification import (
    CordCheck,
    LayoutCheck,
    LimitViolation,
)
from defsense_fab.optimize.prediction.layout_judge import JudgedLayout
from defsense_fab.studio.cords.cord_results import broken_cords, error_table, limit_words
from defsense_fab.studio.workbench.page_tables import full_pose_errors

PER_STATE = {"rest": 0.1, "bend@0.5": 0.8, "bend@1": 2.0, "twist@1": 1.0, "bend@1+twist@1": 9.0}


def judged(error):
    return JudgedLayout(error, "quadratic", PER_STATE, tuple(PER_STATE), np.zeros((5, 2)))


def test_each_pose_is_told_at_its_extreme():
    assert full_pose_errors(PER_STATE) == {"bend": 2.0, "twist": 1.0}
    lines = error_table(judged(1.234), None).splitlines()
    assert lines[:2] == ["### 1.23 mm", "expected on unseen states (quadratic)"]
    assert lines[-2:] == ["| bend | 2.00 | █████████ |", "| twist | 1.00 | ████ |"]


def test_a_name_neither_ends_its_cell_nor_is_taken_for_html():
    told = JudgedLayout(1.0, "affine", {"a|<b>@1": 1.0}, ("a|<b>@1",), np.zeros((1, 1)))
    assert error_table(told, None).splitlines()[-1].startswith("| a\\|&lt;b&gt; | 1.00 |")


def test_a_drag_is_told_by_how_much_it_changes():
    assert error_table(judged(1.0), judged(1.25)).startswith("### 1.00 mm (-0.25)")
    assert error_table(judged(1.0), judged(1.001)).startswith("### 1.00 mm\n")
    assert error_table(None, None) == "no cord yet: add one"


def test_limits_and_what_breaks_them():
    thin = LimitViolation("wall-too-thin", "cord 'b' leaves a wall of 0.40 mm", ("b",), 0.4)
    cords = (
        CordCheck(140.0, np.inf, 2.8, (1.0, 1.5), (), np.zeros((0, 3))),
        CordCheck(90.0, 12.0, 0.4, (1.0, np.inf), (thin,), np.ones((1, 3))),
    )
    check = LayoutCheck(cords, 5.0, (thin,), np.ones((1, 3)))
    lines = limit_words(check, ["a", "b"]).splitlines()
    assert lines[2] == "| a | 142 mm | straight | 2.8 mm |"
    assert lines[3] == "| b | 91 mm | 12 mm | 0.4 mm |"
    assert lines[-1] == "- cord 'b' leaves a wall of 0.40 mm"
    assert broken_cords(check, ["a", "b"]) == {"b"}
