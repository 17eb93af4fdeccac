"""What the page says of searches and layouts, of numbers that are given."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from defsense_fab.core.curve import Hermite, Plane, catmull_rom
from defsense_fab.core.device.device import Sensor
from defsense_fab.optimize.prediction.compare_layouts import ComparedLayout
from defsense_fab.optimize.prediction.layout_judge import JudgedLayout
from defsense_fab.studio.optimize.error_map import color_bar, colored
from defsense_fab.studio.optimize.layout_comparison import compared_table, said_of, scatter
from defsense_fab.studio.optimize.watched_search import pose_table, SearchRecord
from defsense_fab.studio.workbench.build_job import CandidateLayout


def judged(error):
    return JudgedLayout(error, "affine", {"bend@1": 2 * error}, ("bend@1",), np.zeros((1, 1)))


def seen(seconds, *, kept):
    return CandidateLayout(Path("build"), (), 1.0, kept, seconds)


def test_the_best_is_of_layouts_that_keep_every_limit():
    record = SearchRecord()
    assert record.add(seen(5.0, kept=True), judged(3.0))
    assert not record.add(seen(6.0, kept=False), judged(1.0))
    assert not record.add(seen(7.0, kept=False), None)
    assert record.add(seen(8.0, kept=True), judged(2.0))
    assert not record.add(seen(9.0, kept=True), judged(2.5))
    seconds, passed, least = record.curve
    assert seconds.tolist() == [0.0, 1.0, 3.0, 4.0]
    assert passed.tolist() == [3.0, 1.0, 2.0, 2.5]
    assert least.tolist() == [3.0, 3.0, 2.0, 2.0]
    assert record.best.seconds == 8.0


def test_a_long_search_keeps_a_curve_that_can_be_sent():
    record = SearchRecord()
    for k in range(5000):
        record.add(seen(float(k), kept=True), judged(5000.0 - k))
    seconds, _, least = record.curve
    assert len(seconds) <= 1200
    assert seconds[-1] > 4900
    assert (np.diff(least) < 0).all()


def test_poses_are_told_as_drawn_and_now():
    lines = pose_table({"bend@0.5": 1.0, "bend@1": 3.0}, {"bend@1": 0.5, "a|b@1": 1.0}).splitlines()
    assert lines[2:] == ["| bend | 3.00 | **0.50** mm |", "| a\\|b | - | **1.00** mm |"]


def cord(height):
    points = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]])
    plane = Plane.from_normal(
        np.array([0, 0, height]), np.array([0, 0, 1.0]), np.array([1.0, 0, 0])
    )
    return Sensor(f"c{height:g}", plane, Hermite(points, catmull_rom(points)))


LAYOUTS = (
    ComparedLayout("most accurate", (cord(1), cord(2)), 0.5, 4, (0.4, 0.9), ("glue <here>",)),
    ComparedLayout("simplest", (cord(1), cord(1)), 0.52, 3, taken=True),
    ComparedLayout("by eye", (cord(1),), 6.0, problem="too short"),
)


def test_layouts_are_told_side_by_side():
    lines = compared_table(LAYOUTS).splitlines()
    assert lines[2:5] == [
        "| most accurate | 0.50 | 0.40–0.90 | 4 | 2 | 2 |",
        "| **simplest** | 0.52 | ? | 3 | 2 | 1 |",
        "| by eye | 6.00 |  | cannot be made | 1 | 1 |",
    ]
    assert "`defsense study` adds" in lines[-1]
    studied = ComparedLayout("study, 1 cord", (cord(1),), 3.0)
    assert "`defsense study`" not in compared_table((*LAYOUTS, studied))
    assert said_of(LAYOUTS[0]) == "- glue &lt;here&gt;"
    assert said_of(LAYOUTS[2]) == "- too short"


def test_errors_are_drawn_against_parts_and_cords():
    page = scatter(LAYOUTS, "simplest")
    parts, cords = page.split("</svg>")[:2]
    assert parts.count("<circle") == 2  # one cannot be made
    assert cords.count("<circle") == 3
    assert page.count("#e68c1e") == 2  # the chosen one, in both
    assert parts.count('stroke-width="2"') == 1  # the band that is known
    assert ">0.5<" in parts
    assert ">5<" in cords
    assert scatter([ComparedLayout("x", (), math.nan)], None) == ""


def test_colours_are_those_of_the_bar():
    mesh = colored(np.eye(3), np.array([[0, 1, 2]]), np.array([0.0, 1.0, 4.0]), 2.0)
    u = mesh.visual.uv[:, 0]
    texels = np.asarray(mesh.visual.material.emissiveTexture)[0]
    picked = texels[np.minimum((u * len(texels)).astype(int), len(texels) - 1)]
    assert picked[0].tolist() == [68, 1, 84]
    assert picked[2].tolist() == [253, 231, 36]
    bar = color_bar(2.0, 4.0, "mm")
    assert "rgb(68, 1, 84), " in bar
    assert "rgb(253, 231, 36)" in bar
    assert "<span>0</span><span>0.5</span><span>1</span><span>1.5</span><span>2</span>" in bar
    assert "the brightest up to 4" in bar
    assert "brightest" not in color_bar(2.0, 1.0, "mm")
