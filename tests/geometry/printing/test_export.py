"""Files for printers: closed surfaces stay closed when they are turned, placed and rounded.

`DEFSENSE_VARIANTS=1000` reads back that many bodies in place of the few of the suite.
"""

from __future__ import annotations

import os

import numpy as np
import pytest
from scipy.spatial import cKDTree

from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.kernels import triangle_kernel
from defsense_fab.geometry.printing.export import write_3mf, write_stl
from defsense_fab.geometry.printing.print_bed import arrange, lay_flat
from tests.conftest import box_surface
from tests.support.written_surfaces import count_faults, read_triangles

VARIANTS = int(os.environ.get("DEFSENSE_VARIANTS", "40"))
BED = (400.0, 400.0, 400.0)
DOWN = np.array([0, 0, -1.0])


def prism(outline, height):
    """Return the prism over a polygon (n, 2) that is seen whole from its first corner."""
    n = len(outline)
    vertices = [[x, y, z] for z in (0.0, height) for x, y in outline]
    faces = [(0, i + 1, i) for i in range(1, n - 1)]
    faces += [(n, n + i, n + i + 1) for i in range(1, n - 1)]
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, j, n + j), (i, n + j, n + i)]
    return Surface(np.array(vertices, float), np.array(faces))


def bar_with_close_corners(gap, length=120.0):
    """Return a bar with two corners `gap` mm apart at the origin."""
    outline = [[0, 0], [length, 0], [length, 30], [0, 30], [-gap / 3, gap]]
    solid = triangle_kernel.to_manifold(prism(outline, 20.0), "bar")
    return triangle_kernel.to_printable_surface(solid, "bar")


def random_body(rng):
    """Return a closed body with corners that are close together, at any place."""
    gap, length = 10 ** rng.uniform(-8, -3), 10 ** rng.uniform(0.5, 2.4)
    body = bar_with_close_corners(gap, length)
    if rng.random() < 0.5:  # a cut at a small angle to a face leaves slivers
        solid = triangle_kernel.to_manifold(body, "bar")
        normal = np.array([0, rng.normal(0, 1e-6), 1.0])
        half = solid.split_by_plane((normal / np.linalg.norm(normal)).tolist(), 10 + gap)[0]
        body = triangle_kernel.to_printable_surface(half, "half")
    return body


def written_faults(folder, surface):
    """Return the faults of a surface in an STL file, and on a plate with a copy of itself."""
    write_stl(surface, folder / "a.stl")
    placed = arrange({"a": surface, "a_2": surface}, BED, "printer", 5.0)
    write_3mf({n: p.surface for n, p in placed.items()}, folder / "a.3mf", "t", together=False)
    read = [*read_triangles(folder / "a.stl").values(), *read_triangles(folder / "a.3mf").values()]
    assert len(read) == 3
    assert all(len(triangles) == len(surface.faces) for triangles in read)
    return [count_faults(triangles) for triangles in read]


@pytest.mark.parametrize("gap", [3e-7, 1e-6, 5e-6])
def test_corners_that_are_apart_stay_apart_on_the_bed(tmp_path, gap):
    surface = lay_flat(bar_with_close_corners(gap), DOWN)
    assert written_faults(tmp_path, surface) == [(0, 0)] * 3


def test_written_bodies_are_closed_in_any_orientation(tmp_path):
    rng = np.random.default_rng(0)
    for _ in range(VARIANTS):
        body, down = random_body(rng), rng.normal(size=3)
        if rng.random() < 0.5:
            down = np.eye(3)[rng.integers(3)] * rng.choice([-1, 1])
        surface = lay_flat(body, down / np.linalg.norm(down))
        assert written_faults(tmp_path, surface) == [(0, 0)] * 3
        written = read_triangles(tmp_path / "a.stl")["a"].reshape(-1, 3)
        assert cKDTree(written).query(surface.vertices)[0].max() < 1e-3
        assert cKDTree(surface.vertices).query(written)[0].max() < 1e-3


def test_surfaces_without_close_corners_are_written_unchanged(tmp_path):
    box = box_surface([0, 0, 0], [80, 30, 10])
    write_stl(box, tmp_path / "a.stl")
    write_3mf({"a": box}, tmp_path / "a.3mf", "t")
    for file in ("a.stl", "a.3mf"):
        triangles = read_triangles(tmp_path / file)["a"]
        assert (triangles == box.vertices[box.faces].astype("<f4")).all()


def test_corners_in_one_place_are_not_torn_apart(tmp_path):
    """Triangles that share no corners by index, two corners of which become one in the file."""
    bar = prism([[0, 0], [120, 0], [120, 30], [0, 30], [-1e-7, 3e-7]], 20.0)
    vertices = bar.vertices[bar.faces].reshape(-1, 3) + 100
    write_stl(Surface(vertices, np.arange(len(vertices)).reshape(-1, 3)), tmp_path / "a.stl")
    assert count_faults(read_triangles(tmp_path / "a.stl")["a"]) == (0, 0)
