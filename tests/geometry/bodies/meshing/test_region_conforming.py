"""Nodes on the borders of regions."""

import numpy as np
import pytest

from defsense_fab.core.device.regions import Box, Cylinder, HalfSpace, Sphere
from defsense_fab.geometry.bodies.meshing.region_conforming import (
    TET_EDGES,
    conform_to_regions,
    tet_quality,
)
from tests.conftest import structured_bar

SHAPES = {
    "box": Box(np.array([-1, -16, -16]), np.array([33.3, 16, 16])),
    "half_space": HalfSpace(np.array([101.0, 0, 0]), np.array([1.0, 0.2, 0])),
    "sphere": Sphere(np.array([75.0, 0, 0]), 11.0),
    "cylinder": Cylinder(np.array([40.0, 0, 0]), np.array([110.0, 0, 0]), 9.0),
}


@pytest.fixture(scope="module", params=["random", "structured"])
def mesh(request, bar_mesh):
    return bar_mesh if request.param == "random" else structured_bar(
        [0, -15, -15], [150, 15, 15], (15, 3, 3)
    )  # fmt: skip


def crossings(mesh, shape):
    """How many edges leave the shape from strictly inside it."""
    edges = np.unique(np.sort(mesh.tets[:, TET_EDGES].reshape(-1, 2), axis=1), axis=0)
    inside = shape.contains(mesh.nodes)
    edges = edges[inside[edges[:, 0]] != inside[edges[:, 1]]]
    a = np.where(inside[edges[:, 0]], edges[:, 0], edges[:, 1])
    b = np.where(inside[edges[:, 0]], edges[:, 1], edges[:, 0])
    x = mesh.nodes
    return int(shape.contains(x[a] + 1e-3 * (x[b] - x[a])).sum())


@pytest.mark.parametrize("name", SHAPES)
def test_regions_end_at_their_borders(mesh, name):
    shape = SHAPES[name]
    conformed = conform_to_regions(mesh, [shape])
    assert crossings(mesh, shape) > 10
    # A ball or rod as thin as a tet leaves no room to move to; flat borders nearly always do.
    allowed_share = 0.15 if name in ("box", "half_space") else 0.5
    assert crossings(conformed, shape) < allowed_share * crossings(mesh, shape)
    before, after = (m.boundary() for m in (mesh, conformed))
    assert after.volume == pytest.approx(before.volume, rel=1e-4)
    low, high = mesh.nodes.min(0), mesh.nodes.max(0)
    assert (conformed.nodes >= low - 1e-9).all()
    assert (conformed.nodes <= high + 1e-9).all()
    assert tet_quality(conformed.nodes[conformed.tets]).min() > min(
        0.19, 0.79 * tet_quality(mesh.nodes[mesh.tets]).min()
    )


def test_matching_region_moves_nothing(mesh):
    whole = Box(np.full(3, -1e3), np.full(3, 1e3))
    assert (conform_to_regions(mesh, [whole]).nodes == mesh.nodes).all()
    assert (conform_to_regions(mesh, []).nodes == mesh.nodes).all()


def test_the_order_of_the_shapes_does_not_matter(mesh):
    """Two borders less than an edge apart want the same nodes."""
    close_shapes = [SHAPES["box"], Box(np.array([-1, -16, -16]), np.array([36.0, 16, 16])),
            Sphere(np.array([30.0, 0, 0]), 11.0)]  # fmt: skip
    one, other = (
        conform_to_regions(mesh, close_shapes),
        conform_to_regions(mesh, close_shapes[::-1]),
    )
    assert one.digest == other.digest
    assert (one.nodes != conform_to_regions(mesh, close_shapes[:1]).nodes).any()


def test_a_slab_inside_a_face_does_not_bend_the_body():
    """A thin region about a flat face, as a plane of symmetry asks for: creases stay."""
    mesh = structured_bar([0, -15, -15], [150, 15, 15], (15, 3, 3))
    slab = Box(np.array([-1, -15.2, -16]), np.array([151, -14.8, 16]))
    conformed = conform_to_regions(mesh, [slab])
    assert conformed.boundary().volume == pytest.approx(mesh.boundary().volume, rel=1e-9)
    flat = np.abs(mesh.nodes[:, 1] + 15) < 1e-9
    assert (conformed.nodes[flat] == mesh.nodes[flat]).all()
