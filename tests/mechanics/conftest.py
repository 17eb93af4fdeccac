"""Provide a bar between a fixed base and a rigid tip, and the models under test."""

import numpy as np
import pytest

from defsense_fab.mechanics.elements.material import neo_hookean, split, stable_neo_hookean
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.mechanics.loading.boundary_conditions import BoundaryConditions, RigidHandle

MODELS = {
    "neo-hookean": neo_hookean(0.2, 5.0),
    "stable": stable_neo_hookean(0.2, 5.0),
    "mooney-rivlin": split(5.0, 0.07, c01=0.03, model="mooney-rivlin"),
    "yeoh": split(5.0, 0.1, c20=-0.01, c30=0.002, model="yeoh"),
}
FREE = np.full(3, np.nan)


@pytest.fixture(params=MODELS.values(), ids=MODELS.keys())
def material(request):
    return request.param


@pytest.fixture(scope="session")
def mesh(bar_mesh):
    return QuadraticMesh.from_linear(bar_mesh)


@pytest.fixture(scope="session")
def clamp():
    """Return a function for conditions of a long body along x: base held, tip moved."""

    def make(mesh, rotation=(0, 0, 0), translation=FREE, free_axes=None, **more):
        x = mesh.nodes
        tip = np.flatnonzero(x[:, 0] > x[:, 0].max() - 10)
        handle = RigidHandle(
            tip,
            (x[tip].min(0) + x[tip].max(0)) / 2,
            np.array(rotation, float),
            np.array(translation, float),
            np.zeros((0, 3)) if free_axes is None else np.array(free_axes, float),
            "tip",
        )
        base = np.flatnonzero(x[:, 0] < x[:, 0].min() + 10)
        return BoundaryConditions(base, (handle,), **more)

    return make
