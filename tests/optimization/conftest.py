"""Provide a bar that is twisted exactly, with markers on its upper face, and searches on it."""

import numpy as np
import pytest

from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.optimization.problem.cord_signals import SignalModel
from defsense_fab.optimization.problem.problem import Limits, Problem
from defsense_fab.optimization.refinement.refine import optimize_layout
from defsense_fab.optimization.search.starting_layouts import LayoutSearch
from defsense_fab.sensing.response import Response

LIMITS = Limits(wall=1.2, min_radius=5.0, clearance=3.4, channel_diameter=2.2)


def ignore(fraction, message):
    """Report nothing."""


def search(problem, drawn=(), seed=0, **options):
    """Return the result of a search for layouts, with the fields of `LayoutSearch`."""
    rng = np.random.default_rng(seed)
    return optimize_layout(problem, drawn, rng, ignore, LayoutSearch(**options))


def check_jacobian(inequalities, x, jacobian):
    """Compare the derivatives (g, size) of inequalities at x (size,) with finite differences."""
    for i in range(len(x)):
        e = 1e-6 * np.eye(len(x))[i]
        slope = (inequalities(x + e)[0] - inequalities(x - e)[0]) / 2e-6
        assert jacobian[:, i] == pytest.approx(slope, rel=1e-4, abs=1e-5)


@pytest.fixture(scope="module")
def problem(bar, bar_mesh):
    """Return a problem with exact twists of -45 to 45 degrees at the nodes."""
    mesh = QuadraticMesh.from_linear(bar_mesh)

    def twisted(p, angle):
        a = angle * p[:, 0] / 150
        y = p[:, 1] * np.cos(a) - p[:, 2] * np.sin(a)
        z = p[:, 1] * np.sin(a) + p[:, 2] * np.cos(a)
        return np.stack([np.zeros(len(p)), y - p[:, 1], z - p[:, 2]], axis=1)

    angles = np.deg2rad([-45, -22.5, 22.5, 45])
    fields = np.stack([twisted(mesh.nodes, a) for a in angles])
    points = np.random.default_rng(0).uniform([0, -15, 15], [150, 15, 15], (30, 3))
    markers = np.stack([twisted(points, a) for a in (0.0, *angles)])
    return Problem(
        bar,
        PointLocator(mesh),
        fields,
        markers,
        np.full(30, 1 / 30),
        SignalModel(Response.line(2.0)),
        0.0005,
        LIMITS,
    )
