"""Check layouts of increasing numbers of cords, the knee, added cords and shared planes."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.curve import distinct_planes
from defsense_fab.core.errors import LayoutError
from defsense_fab.optimization.limits.verification import verify
from defsense_fab.optimization.refinement.refine import Cancelled, layout_error, optimize_layout
from defsense_fab.optimization.search.starting_layouts import LayoutSearch
from defsense_fab.optimization.studies.cord_count import add_cord, find_knee, layouts_by_count
from tests.optimization.conftest import LIMITS, ignore, search
from tests.support.errors import raises


@pytest.mark.slow
def test_the_error_never_rises_with_the_number_of_cords(problem):
    found = list(layouts_by_count(problem, [1, 2, 3], 0, ignore))
    errors = [layout_error(problem, layout) for _, layout in found]
    assert [n for n, _ in found] == [1, 2, 3]
    assert errors == sorted(errors, reverse=True)
    assert not any(verify(layout, problem.surface, LIMITS).violations for _, layout in found)


@pytest.mark.slow
def test_a_continued_study_finds_the_same(problem):
    whole = list(layouts_by_count(problem, [1, 2], 0, ignore, planes=1))
    ((count, layout),) = layouts_by_count(problem, [2], 0, ignore, previous=whole[0][1], planes=1)
    assert count == 2
    assert layout_error(problem, layout) == layout_error(problem, whole[1][1])
    assert len(distinct_planes([s.plane for s in layout])) == 1


def test_the_next_cord_leaves_the_others(problem, straight):
    drawn = [straight("a", y=6), straight("b", y=-6)]
    layout = add_cord(problem, drawn, np.random.default_rng(0), ignore)
    assert list(layout[:2]) == drawn
    assert len(layout) == 3
    assert layout_error(problem, layout) < layout_error(problem, drawn)
    assert not verify(layout, problem.surface, LIMITS).violations


@pytest.mark.slow
@pytest.mark.parametrize("planes", [1, 2])
def test_a_limit_on_planes(problem, planes):
    found = search(problem, extra=3, planes=planes, starts=2, candidates=3000)
    assert len(distinct_planes([s.plane for s in found.sensors])) <= planes
    assert not verify(found.sensors, problem.surface, LIMITS).violations
    assert found.rmse <= layout_error(problem, found.initial)


@pytest.mark.slow
def test_a_limit_on_planes_keeps_the_planes_of_drawn_cords(problem, straight):
    locked = [straight("a", y=6, z=8, free=[]), straight("b", y=6, z=-8, free=["path"])]
    joined = [straight("a", y=6, z=8), straight("b", y=-6, z=8)]
    for drawn, extra in ((locked, 1), (locked[:1], 1), (joined, 0), (joined, 1)):
        allowed = len(distinct_planes([s.plane for s in drawn]))
        found = search(problem, drawn, extra=extra, planes=1, starts=2, candidates=2000)
        assert len(distinct_planes([s.plane for s in found.sensors])) <= allowed
        for before, after in zip(drawn, found.sensors, strict=False):
            assert after.free == before.free
            if "plane" not in before.free:
                assert distinct_planes([before.plane, after.plane]) == [before.plane]
        assert not verify(found.sensors, problem.surface, LIMITS).violations


def test_cancelling_keeps_the_best_so_far(problem):
    seen = []

    def report(fraction, message):
        if fraction > 0.4:
            raise Cancelled

    found = optimize_layout(
        problem,
        [],
        np.random.default_rng(0),
        report,
        LayoutSearch(extra=1, candidates=2000),
        watch=lambda layout, error: seen.append((layout, error)),
    )
    assert seen[-1] == (found.sensors, found.rmse)
    assert [e for _, e in seen] == sorted((e for _, e in seen), reverse=True)


def test_more_cords_than_fit_are_refused(problem):
    tight = replace(problem, limits=replace(LIMITS, clearance=70.0))
    with raises(LayoutError, "no-room-for-cords", count=4) as caught:
        search(tight, extra=4, starts=2, candidates=2000)
    assert caught.value.data["found"] in (1, 2, 3)


def test_the_knee_of_a_bent_line():
    errors = np.array([8.0, 4.0, 1.0, 0.9, 0.8, 0.75])
    assert find_knee([1, 2, 3, 4, 5, 6], errors) == 3
    assert find_knee([2, 3], np.array([1.0, 0.5])) == 3
