"""Check the paper's baselines and its joint iteration against the search."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from benchmarks import joint
from defsense_fab.core.curve import distinct_planes
from defsense_fab.core.errors import LayoutError
from defsense_fab.optimization.limits.verification import verify
from defsense_fab.optimization.refinement.refine import layout_error, optimize_layout
from defsense_fab.optimization.search.baselines import manual_layout, middle_plane, visual_layout
from defsense_fab.optimization.search.starting_layouts import LayoutSearch
from tests.conftest import box_surface, structured_bar
from tests.optimization import exact
from tests.support.errors import raises


@pytest.fixture(scope="module")
def bends(bar):
    mesh = structured_bar([0, -15, -15], [150, 15, 15], [15, 3, 3])
    return exact.problem(bar, mesh, exact.RAMPS, noise=0.002)


def test_full_beats_visual_beats_manual(bends):
    rng = np.random.default_rng(0)
    layouts = [
        manual_layout(bends, 3),
        visual_layout(bends, 3, rng),
        optimize_layout(bends, [], rng, lambda f, m: None, LayoutSearch(extra=3, starts=2)).sensors,
    ]
    errors = [layout_error(bends, layout) for layout in layouts]
    assert errors[0] > 3 * errors[1] > 3 * 1.5 * errors[2]
    for layout in layouts:
        assert not verify(layout, bends.surface, bends.limits).violations
    assert len(distinct_planes([s.plane for s in layouts[0]])) == 1
    along = [s.plane.axes[:, 0] for layout in layouts[:2] for s in layout]
    assert np.abs(along) == pytest.approx(np.repeat([[1.0, 0, 0]], 6, axis=0))


def test_baselines_without_room_are_refused(bends):
    tight = replace(bends, limits=replace(bends.limits, shortest=200.0))
    for place in (manual_layout, partial(visual_layout, rng=np.random.default_rng(0))):
        with raises(LayoutError, "no-room-for-cords", count=3):
            place(tight, 3)


@pytest.mark.parametrize("size", [(40.0, 40.0, 40.0), (30.0, 40.0, 40.0), (40.0, 40.0, 30.0)])
def test_the_middle_plane_of_a_body_with_equal_edges(size):
    plane = middle_plane(box_surface([0, 0, 0], size))
    assert plane.axes[:, 0] @ plane.normal == 0
    assert np.array(size) @ np.abs(plane.axes[:, 0]) == max(size)
    assert np.array(size) @ np.abs(plane.normal) == min(size)


def test_the_joint_problem_has_the_same_stationary_points(bends):
    """At the best map the gradient by the paths is that of the objective, and by the map zero."""
    layout = visual_layout(bends, 2, np.random.default_rng(0))
    residual, jacobian, start, objective = joint.system(bends, layout, penalty=0.0)
    size = sum(c.size for c in objective.cords)
    value, gradient = objective(np.zeros(size))
    assert (residual(start) ** 2).sum() / len(bends.outputs) == pytest.approx(value, rel=1e-9)
    theirs = 2 * jacobian(start).T @ residual(start) / len(bends.outputs)
    assert theirs[:size] == pytest.approx(gradient, rel=1e-6, abs=1e-9 * value)
    assert np.abs(theirs[size:]).max() < 1e-9 * value


def test_the_joint_iteration_improves_a_layout(bends):
    start = visual_layout(bends, 1, np.random.default_rng(0))
    layout = joint.refine(bends, start, 30)
    assert layout_error(bends, layout) < layout_error(bends, start)
