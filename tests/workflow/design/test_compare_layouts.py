"""The layouts that a build made on trial."""

from __future__ import annotations

from dataclasses import replace

import pytest

from defsense_fab.core.errors import StorageError
from defsense_fab.optimization.prediction.choose_layout import offered_layouts, prefer_layout
from defsense_fab.store.build import Build
from defsense_fab.store.layout import (
    CordPath,
    WeighedCords,
    WeighedRecord,
    load_layout,
    load_prediction,
    load_weighed,
    save_layout,
    save_weighed,
)
from defsense_fab.workflow.design.compare_layouts import FULL, SIMPLE, tried_layouts
from tests.support.errors import raises
from tests.twin.conftest import small_bar as small_bar_fixture

small_bar = small_bar_fixture


def trial(built, parts, *, warnings=(), problem=None, chosen=False, slanted=0):
    return WeighedRecord(built or 0.4, built, 2, slanted, parts, 9.0, 0, warnings, problem, chosen)


TRIALS = (
    trial(0.50, 5),
    trial(None, None, problem="too short"),
    trial(0.52, 4, chosen=True),
    trial(0.51, 4, warnings=("glue",)),
    trial(0.70, 2),
)


def test_the_fewest_parts_of_similar_layouts_or_the_best_are_preferred():
    assert prefer_layout(TRIALS, "simple") is TRIALS[2]
    assert prefer_layout(TRIALS, "accuracy") is TRIALS[0]
    assert prefer_layout(TRIALS[1:2], "simple") is None
    better = replace(TRIALS[4], built=0.62)
    assert prefer_layout((*TRIALS[:4], better), "simple") is better
    assert prefer_layout(TRIALS, "simple", parts=5) is TRIALS[0]
    assert prefer_layout(TRIALS, "simple", parts=3) is None


def test_one_layout_is_offered_for_each_number_of_parts():
    assert offered_layouts(TRIALS, "simple") == [TRIALS[4], TRIALS[2], TRIALS[0]]
    assert offered_layouts(TRIALS[1:2], "simple") == []
    assert offered_layouts((*TRIALS, trial(147.0, 3)), "simple") == [
        TRIALS[4],
        TRIALS[2],
        TRIALS[0],
    ]


@pytest.fixture
def built(small_bar, tmp_path):
    """Return the folder of a build with five tried layouts; the third has its cords reversed."""
    layout = replace(load_layout(small_bar / "build"), weighed=TRIALS)
    save_layout(tmp_path, layout, load_prediction(small_bar / "build"))
    cords = tuple(CordPath.of(s.sensor()) for s in layout.sensors)
    save_weighed(tmp_path, WeighedCords((cords, cords, cords[::-1], cords, cords)))
    return tmp_path


def test_all_tried_layouts_are_returned_in_order(built):
    layouts = tried_layouts(Build(built))
    assert [layout.name for layout in layouts] == [
        FULL,
        "candidate 2",
        SIMPLE,
        "candidate 4",
        "candidate 5",
    ]
    assert [layout.error for layout in layouts] == [0.50, 0.4, 0.52, 0.51, 0.70]
    assert layouts[1].problem == "too short"
    assert [layout.is_built for layout in layouts] == [False, False, True, False, False]
    band = load_layout(built).band
    assert [layout.band for layout in layouts] == [None, None, (band.low, band.high), None, None]
    assert [s.name for s in layouts[2].sensors] == ["cord_2", "cord_1"]
    assert layouts[0].planes == 2


def test_earlier_builds_have_only_the_chosen_layout(built):
    (built / "layouts.json").unlink()
    (layout,) = tried_layouts(Build(built))
    assert (layout.name, layout.error, layout.parts) == ("optimized", 0.52, 4)
    assert [s.name for s in layout.sensors] == ["cord_1", "cord_2"]
    with raises(StorageError, "file-not-found"):
        load_weighed(built)
