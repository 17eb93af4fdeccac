"""Pads of printed traces keep their distance from each other and from other traces."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.curve import REST_FRAME, Hermite, catmull_rom
from defsense_fab.core.device.device import Sensor
from defsense_fab.optimization.limits.constraints import Constraints
from defsense_fab.optimization.limits.verification import verify
from defsense_fab.optimization.problem.cord_parameters import CordParameters
from tests.optimization.conftest import LIMITS, check_jacobian, search

pytestmark = pytest.mark.slow
PADS = replace(LIMITS, pad=(4.5, 4.6), is_cut=False)


def loop(name, y, z, width):
    """Return a path from x = 0 into the bar and back, with its ends `width` apart."""
    points = [[2, 0], [10, 0], [40, 0], [60, 0], [66, 0.5], [60, 1], [40, 1], [10, 1], [2, 1]]
    points = np.array([[x, y + width * (side - 0.5), z] for x, side in points], float)
    return Sensor(
        name, REST_FRAME, Hermite(points, catmull_rom(points)), frozenset({"path", "ends"})
    )


def codes(problem, limits, *sensors):
    found = verify(sensors, problem.surface, limits).violations
    return {v.code: v.value for v in found}


def test_derivatives_by_finite_differences(problem, straight):
    cords = [
        CordParameters(loop("loop", 3, 3, 8.0)),
        CordParameters(straight("a", y=-5).in_space()),
        CordParameters(straight("fixed", y=-9, free=frozenset()).in_space()),
    ]
    constraints = Constraints(problem.surface, problem.depth, PADS, cords)
    x = np.random.default_rng(6).normal(0, 0.3, sum(c.size for c in cords))
    values, jacobian = constraints(x)
    without = Constraints(problem.surface, problem.depth, replace(PADS, pad=(0.0, 0.0)), cords)(x)[
        0
    ]
    # 15 pairs of the six pads; each pad next to three paths, of which the own one counts as well.
    assert len(values) == len(without) + 15 + 18
    check_jacobian(constraints, x, jacobian)


def test_pads_of_one_trace_keep_apart(problem):
    needed = PADS.pad_to_pad
    assert "pad-too-close" not in codes(problem, PADS, loop("a", 0, 0, needed + 0.1))
    found = codes(problem, PADS, loop("a", 0, 0, needed - 0.1))
    assert found["pad-too-close"] == pytest.approx(needed - 0.1, abs=0.01)


@pytest.mark.parametrize("x", [2.5, 4.6])
def test_a_trace_keeps_away_from_the_whole_depth_of_a_pad(problem, straight, x):
    """A trace along y passes above the axis of the pad at x = 0, which is 4.6 mm deep."""
    along = straight("along", y=0).in_space()
    for gap in (PADS.pad_to_path + 0.1, PADS.pad_to_path - 0.1):
        points = np.array([[x, y, gap] for y in np.linspace(-13, 13, 8)])
        across = Sensor("across", REST_FRAME, Hermite(points, catmull_rom(points)), frozenset())
        found = codes(problem, PADS, along, across)
        assert ("pad-too-close" in found) == (gap < PADS.pad_to_path)


def test_a_search_keeps_pads_apart(problem):
    limits = replace(PADS, wall=1.2)
    found = search(
        replace(problem, limits=limits), extra=2, starts=1, candidates=800, in_space=True
    )
    assert not verify(found.sensors, problem.surface, limits).violations
