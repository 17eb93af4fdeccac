"""The record, tables and charts of the Optimize mode, computed from given numbers."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from defsense_fab.core.curve import Hermite, Plane, catmull_rom
from defsense_fab.core.device.device import Sensor
from defsense_fab.studio.optimize.layout_comparison import (
    comparison_table,
    error_charts,
    layout_notes,
)
from defsense_fab.studio.optimize.watched_search import SearchRecord, pose_table
from defsense_fab.studio.workbench.build_job import CandidateLayout
from defsense_fab.workflow.design.compare_layouts import ComparedLayout
from defsense_fab.workflow.design.layout_judge import JudgedLayout


def judged(error):
    return JudgedLayout(error, "affine", {"bend": 2 * error}, {}, np.zeros((1, 1)))


def candidate(seconds, *, is_best):
    return CandidateLayout(Path("build"), (), 1.0, is_best, seconds)


def test_the_best_layout_keeps_every_limit():
    record = SearchRecord()
    assert record.add(candidate(5.0, is_best=True), judged(3.0))
    assert not record.add(candidate(6.0, is_best=False), judged(1.0))
    assert not record.add(candidate(7.0, is_best=False), None)
    assert record.add(candidate(8.0, is_best=True), judged(2.0))
    assert not record.add(candidate(9.0, is_best=True), judged(2.5))
    seconds, current, best = record.curve
    assert seconds.tolist() == [0.0, 1.0, 3.0, 4.0]
    assert current.tolist() == [3.0, 1.0, 2.0, 2.5]
    assert best.tolist() == [3.0, 3.0, 2.0, 2.0]
    assert record.best.seconds == 8.0


def test_the_curve_of_a_long_search_is_thinned():
    record = SearchRecord()
    for k in range(5000):
        record.add(candidate(float(k), is_best=True), judged(5000.0 - k))
    seconds, _, best = record.curve
    assert len(seconds) <= 1200
    assert seconds[-1] > 4900
    assert (np.diff(best) < 0).all()


def test_pose_table_has_the_drawn_and_the_best_cords():
    lines = pose_table({"bend": 3.0}, {"bend": 0.5, "a|b": 1.0}).splitlines()
    assert lines[2:] == ["| bend | 3.00 | **0.50** mm |", "| a\\|b | - | **1.00** mm |"]


def cord(height):
    points = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]])
    plane = Plane.from_normal(
        np.array([0, 0, height]), np.array([0, 0, 1.0]), np.array([1.0, 0, 0])
    )
    return Sensor(f"c{height:g}", plane, Hermite(points, catmull_rom(points)))


LAYOUTS = (
    ComparedLayout("most accurate", (cord(1), cord(2)), 0.5, 4, (0.4, 0.9), ("glue <here>",)),
    ComparedLayout("simplest", (cord(1), cord(1)), 0.52, 3, is_built=True),
    ComparedLayout("by eye", (cord(1),), 6.0, problem="too short"),
)


def cells(row):
    return [cell.strip() for cell in row.strip("|").split("|")]


def test_comparison_table_has_a_row_for_each_layout():
    lines = comparison_table(LAYOUTS).splitlines()
    assert cells(lines[2]) == ["most accurate", "0.50", "0.40–0.90", "4", "2", "2"]
    assert cells(lines[3]) == ["**simplest**", "0.52", "?", "3", "2", "1"]
    problem = cells(lines[4])
    assert [problem[k] for k in (0, 1, 2, 4, 5)] == ["by eye", "6.00", "", "1", "1"]
    assert not problem[3].isdigit()


def test_the_study_is_mentioned_until_it_has_run():
    assert "`defsense study`" in comparison_table(LAYOUTS)
    studied = ComparedLayout("1 cord", (cord(1),), 3.0, is_studied=True)
    assert "`defsense study`" not in comparison_table((*LAYOUTS, studied))


def test_notes_of_a_layout_are_escaped():
    assert layout_notes(LAYOUTS[0]) == "- glue &lt;here&gt;"
    assert layout_notes(LAYOUTS[2]) == "- too short"


def test_charts_show_errors_over_parts_and_cords():
    page = error_charts(LAYOUTS, "simplest")
    parts, cords = page.split("</svg>")[:2]
    assert parts.count("<circle") == 2  # the third layout cannot be made
    assert cords.count("<circle") == 3
    assert page.count("#e68c1e") == 2  # the chosen layout, in both charts
    assert parts.count('stroke-width="2"') == 1  # only one range is known
    assert ">0.5<" in parts
    assert ">5<" in cords
    assert error_charts([ComparedLayout("x", (), math.nan)], None) == ""
