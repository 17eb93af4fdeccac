"""The method's closed-form bar: 150 x 30 x 30 mm, bent to a constant curvature by up to 30 degrees
after a uniform twist of up to 45, with 40 markers on its four long edges.

The fields are exact at the nodes of quadratic tets of 5 mm; between them the tets' own polynomial
differs by less than 1e-3 mm.
"""

import itertools

import numpy as np

from defsense_fab.core.mesh import Surface
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.optimization.problem.cord_signals import SignalModel
from defsense_fab.optimization.problem.problem import Limits, Problem
from defsense_fab.sensing.response import Response

LENGTH = 150.0
LIMITS = Limits(wall=1.2, min_radius=5.0, clearance=3.4, channel_diameter=2.2)
MARKERS = np.array(
    [[x, y, z] for x in np.linspace(20, LENGTH, 10) for y in (-15.0, 15.0) for z in (-15.0, 15.0)]
)

TWISTS = [(0.0, t) for t in np.linspace(-1, 1, 9) if t]
RAMPS = [(s * b, 0.0) for s in (-1, 1) for b in (0.25, 0.5, 0.75, 1.0)] + [
    (0.0, t) for t in (0.25, 0.5, 0.75, 1.0)
]
MIXTURES = [m for m in itertools.product((-1, -0.5, 0, 0.5, 1), (0, 0.5, 1)) if any(m)]
UNSEEN = list(itertools.product((-0.75, -0.25, 0.25, 0.75), (0.25, 0.75)))


def displacement(points, bend, twist):
    """Return displacements (p, 3) mm of points at fractions of the full bend and twist."""
    x, y, z = points.T
    a = twist * np.pi / 4 * x / LENGTH
    y, z = y * np.cos(a) - z * np.sin(a), y * np.sin(a) + z * np.cos(a)
    angle = bend * np.pi / 6
    if angle:
        radius = LENGTH / angle
        x, z = (radius - z) * np.sin(x / radius), radius - (radius - z) * np.cos(x / radius)
    return np.stack([x, y, z], axis=1) - points


def problem(bar_surface, mesh, states, decoder="affine", noise=0.0):
    """Return the problem with states given as pairs of fractions, without rest."""
    quadratic = QuadraticMesh.from_linear(mesh)
    return Problem(
        Surface(bar_surface.vertices, bar_surface.faces),
        PointLocator(quadratic),
        np.stack([displacement(quadratic.nodes, *s) for s in states]),
        np.stack([displacement(MARKERS, *s) for s in [(0.0, 0.0), *states]]),
        np.full(len(MARKERS), 1 / len(MARKERS)),
        SignalModel(Response.line(1.0)),
        noise,
        LIMITS,
        decoder,
    )
