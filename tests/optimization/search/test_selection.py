"""Select new cords next to fixed ones."""

import pytest

from defsense_fab.optimization.limits.verification import verify
from tests.optimization.conftest import search


@pytest.mark.parametrize("distance", [3.6, 4.8])
def test_a_cord_is_added_next_to_two_close_cords(problem, straight, distance):
    """The fixed cords keep their clearance of 3.4 mm by less than coarse samples can resolve."""
    locked = tuple(
        straight(name, y, 5.0, free=()) for name, y in (("a", -distance / 2), ("b", distance / 2))
    )
    assert not verify(locked, problem.surface, problem.limits).violations
    found = search(problem, locked, seed=1, extra=1, starts=1, finalists=1, candidates=1500)
    assert [s.name for s in found.sensors] == ["a", "b", "C"]
    assert not verify(found.sensors, problem.surface, problem.limits).violations
