"""Tools that are cut out of solids."""

import manifold3d as m3
import numpy as np
import pytest

from defsense_fab.geometry.kernels.cutting_tools import Frustum
from defsense_fab.geometry.kernels.triangle_kernel import cut_out


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("length", "removed"), [(0.0, 0.0), (4.0, 4 * np.pi)])
def test_a_tool_removes_its_volume(length, removed):
    start = np.array([3.0, 4, 2])
    tool = Frustum(start, start + length * np.eye(3)[2], (1.0, 1.0))
    assert cut_out(m3.Manifold.cube([10.0, 10, 10]), [tool]).volume() == pytest.approx(
        1000 - removed
    )
