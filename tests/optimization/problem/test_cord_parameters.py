"""Check the freedom of planes with a fixed direction and of planes shared by cords."""

import numpy as np
import pytest

from defsense_fab.optimization.problem.cord_parameters import FRAME_SIZE, shared_parameters
from defsense_fab.optimization.refinement.descent import jitter


@pytest.mark.parametrize("free", [("path", "offset"), ("offset",)])
def test_a_plane_with_a_fixed_direction_keeps_it(straight, free):
    drawn = (straight("a", y=3.0, z=2.0, free=free),)
    for seed in range(5):
        (moved,) = jitter(drawn, np.random.default_rng(seed), tied=False)
        assert np.abs(moved.plane.normal - [0, 0, 1]).max() < 1e-12
        assert abs(moved.plane.origin[2] - 2.0) > 1e-3
        assert moved.free == set(free)
    size = shared_parameters(drawn)[1].shape
    assert size[0] - size[1] == 2  # the two turns out of the plane


def test_a_shared_plane_is_as_free_as_the_least_free_of_its_cords(straight):
    kinds = {"free": ("path", "plane"), "offset": ("path", "offset"), "locked": ("path",)}
    own = straight(free=["path"]).curve.points.shape[0] * 2 - 6  # two rows fewer at each end, twice
    for names, frame in (
        (("free", "free"), FRAME_SIZE),
        (("free", "offset"), FRAME_SIZE - 2),
        (("offset", "free"), FRAME_SIZE - 2),
        (("offset", "locked"), 0),
        (("locked", "free"), 0),
    ):
        pair = [straight(n + str(k), y=6.0 * k, free=kinds[n]) for k, n in enumerate(names)]
        assert shared_parameters(pair)[1].shape[1] == 2 * 2 * own + frame, names
        moved = jitter(tuple(pair), np.random.default_rng(0), tied=True)
        assert moved[0].plane.coincides(moved[1].plane)
        assert (abs(moved[0].plane.normal[2]) > 1 - 1e-12) == (frame < FRAME_SIZE)
