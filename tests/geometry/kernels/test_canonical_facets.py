"""Facets of the same points do not depend on their order and diagonals."""

from functools import cache

import build123d as bd
import numpy as np
import pytest

from defsense_fab.geometry.kernels import occ
from defsense_fab.geometry.kernels.canonical_facets import canonicalize


@cache
def solids():
    rounded = bd.fillet(bd.Box(40, 30, 20).edges(), 4)
    bored = bd.Box(40, 20, 20) - bd.Cylinder(4, 20)
    ring = bd.Torus(20, 6)
    return {"rounded": rounded, "bored": bored, "ring": ring, "ball": bd.Sphere(12)}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rounded", "bored", "ring", "ball"])
def test_a_solid_and_its_step_file_have_the_same_facets(tmp_path, name):
    solid = solids()[name].solid().wrapped
    occ.write_step(solid, tmp_path / "a.step", "a")
    (back,) = occ.read_step(tmp_path / "a.step")
    one, other = occ.tessellate(solid, 0.05), occ.tessellate(back, 0.05)
    np.testing.assert_array_equal(one.vertices, other.vertices)
    np.testing.assert_array_equal(one.faces, other.faces)
    assert one.volume == pytest.approx(occ.volume(solid), rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_order_and_diagonals_do_not_matter(seed):
    """A rounded box whose vertices and facets are shuffled, and a tenth of the diagonals between
    points on a circle changed."""
    rng = np.random.default_rng(seed)
    surface = occ.tessellate(solids()["rounded"].solid().wrapped, 0.05)
    faces = surface.faces.copy()
    edges = {
        (f[k], f[(k + 1) % 3]): (i, f[(k + 2) % 3]) for i, f in enumerate(faces) for k in range(3)
    }
    changed, flips = set(), 0
    for (a, b), (i, c) in edges.items():
        j, d = edges[b, a]
        A, B, C, D = surface.vertices[[a, b, c, d]]
        # A rectangle or trapezium: its diagonals are equal and it is flat.
        flat = abs(np.dot(np.cross(B - A, C - A), D - A)) < 1e-6
        even = abs(np.linalg.norm(A - B) - np.linalg.norm(C - D)) < 1e-6
        if {i, j} & changed or not (flat and even) or rng.random() > 0.1:
            continue
        faces[i], faces[j] = (c, a, d), (d, b, c)
        changed |= {i, j}
        flips += 1
    assert flips > 20
    shuffle = rng.permutation(len(surface.vertices))
    where = np.argsort(shuffle)
    faces = where[faces][rng.permutation(len(faces))]
    vertices, faces_out = canonicalize(surface.vertices[shuffle], np.roll(faces, 1, axis=1))
    np.testing.assert_array_equal(vertices, surface.vertices)
    np.testing.assert_array_equal(faces_out, surface.faces)


def test_facets_of_a_sharp_or_uneven_body_stay():
    """A tetrahedron in random position has no four points of a smooth face on a circle."""
    corners = np.random.default_rng(0).normal(size=(4, 3))
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    vertices, faces_out = canonicalize(corners, faces)
    assert vertices.shape == (4, 3)
    sides = {frozenset(f) for f in faces_out.tolist()}
    assert sides == {frozenset(range(4)) - {k} for k in range(4)}
