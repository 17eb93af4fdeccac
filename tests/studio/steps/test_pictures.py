"""Pictures of poses are drawn from shapes that are kept for a while."""

import numpy as np

from defsense_fab.studio.steps.poses.pictures import drop_oldest


def test_shapes_of_earlier_poses_are_dropped():
    shapes = {str(k): np.zeros((2, 3)) for k in range(100)}
    drop_oldest(shapes, {"0", "99"})
    assert {"0", "98", "99"} <= set(shapes)
    assert len(shapes) < 40
