"""A pose is judged by its error with noise, against how far it moves the surface."""

from types import SimpleNamespace

import numpy as np
import pytest

from defsense_fab.core.mesh import TetMesh
from defsense_fab.workflow.build.pose_errors import pose_errors, warn_of_poor_poses

VERTICES = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


@pytest.fixture
def build():
    """Two poses that move the surface by 40 and 5 mm, and states that are not judged."""
    states = {
        "bend@0.5": ({"bend": 0.5}, 20.0, 0.1),
        "bend@1": ({"bend": 1.0}, 40.0, 0.5),
        "twist@1": ({"twist": 1.0}, 5.0, 0.5),
        "both": ({"bend": 1.0, "twist": 1.0}, 45.0, 9.0),
    }
    displacements = np.zeros((len(states), 4, 3))
    displacements[:, 3, 0] = [moved for _, moved, _ in states.values()]
    errors = {name: error for name, (_, _, error) in states.items()}
    return SimpleNamespace(
        mesh=TetMesh(VERTICES, np.array([[0, 1, 2, 3]])),
        fields=SimpleNamespace(
            names=tuple(states),
            weights=tuple(weights for weights, _, _ in states.values()),
            displacements=displacements,
        ),
        layout=SimpleNamespace(
            prediction=SimpleNamespace(per_state={"rest": 0.0, **errors}, held_out={})
        ),
    )


def test_poses_are_judged_at_their_largest_amplitude(build):
    assert pose_errors(build) == {"bend": (0.5, 40.0), "twist": (0.5, 5.0)}


def test_only_poorly_sensed_poses_are_warned_about(build):
    (warning,) = warn_of_poor_poses(build, "trace")
    assert warning.startswith("twist ")
    assert "10 %" in warning
    assert "trace" in warning
