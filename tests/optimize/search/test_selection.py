"""Select new cords next to fixed ones."""

import numpy as np
import pytest

from defsense_fab.core.curve import Hermite, Plane, catmull_rom
from defsense_fab.core.device.device import Sensor
from defsense_fab.optimize.limits.verification import verify
from defsense_fab.optimize.refinement.refine import optimize_layout


def straight(name, y):
    points = np.array([[x, 0.0] for x in (2, 10, 36, 62, 88, 114, 140, 148)])
    plane = Plane.from_normal(np.array([0, y, 5.0]), np.eye(3)[2], np.eye(3)[0])
    return Sensor(name, plane, Hermite(points, catmull_rom(points)), frozenset())


@pytest.mark.parametrize("distance", [3.6, 4.8])
def test_a_cord_is_added_next_to_two_close_cords(problem, distance):
    """The fixed cords keep their clearance of 3.4 mm by less than coarse samples can resolve."""
    locked = (straight("a", -distance / 2), straight("b", distance / 2))
    assert not verify(locked, problem.surface, problem.limits).violations
    found = optimize_layout(
        problem, locked, np.random.default_rng(1), lambda *_: None, extra=1, starts=1,
        finalists=1, candidates=1500,
    )  # fmt: skip
    assert [s.name for s in found.sensors] == ["a", "b", "cord-1"]
    assert not verify(found.sensors, problem.surface, problem.limits).violations
