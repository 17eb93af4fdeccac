"""Facets that are lines are replaced in files, and surfaces stay closed.

`DEFSENSE_VARIANTS=1000` writes that many bodies in place of the few of the suite; `-s` shows in how
many all lines were replaced.
"""

from __future__ import annotations

import os

import numpy as np
import pytest

from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.printing.export import write_3mf, write_stl
from defsense_fab.geometry.printing.slivers import count_lines, replace_lines
from tests.conftest import box_surface
from tests.support.tally import Tally
from tests.support.written_surfaces import count_faults, read_triangles

VARIANTS = int(os.environ.get("DEFSENSE_VARIANTS", "40"))


def split_side(surface, facet, side, share):
    """Split a side of one facet alone, and close the gap with a facet that is a line."""
    u, v, x = np.roll(surface.faces[facet], -side)
    w = len(surface.vertices)
    point = surface.vertices[u] + share * (surface.vertices[v] - surface.vertices[u])
    faces = surface.faces.copy()
    faces[facet] = (u, w, x)
    new = [(w, v, x), (u, v, w)]
    return Surface(np.vstack([surface.vertices, point]), np.vstack([faces, new]))


def body_with_lines(rng, count):
    """Return a box with sides of facets that were split, also those of facets that are lines."""
    size = 64.0 * rng.integers(1, 3, 3)
    surface = box_surface([0, 0, 0], size)
    for _ in range(count):
        facet = int(rng.integers(len(surface.faces)))
        side, share = int(rng.integers(3)), float(rng.choice([0.25, 0.5, 0.75]))
        split = split_side(surface, facet, side, share)
        if len(np.unique(split.vertices, axis=0)) == len(split.vertices):
            surface = split
    return surface


def as_surface(triangles):
    vertices, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    return Surface(vertices.astype(float), index.reshape(-1, 3))


def written(folder, surface):
    """Return the surfaces in an STL and in a 3MF file."""
    write_stl(surface, folder / "a.stl")
    write_3mf({"a": surface}, folder / "a.3mf", "a")
    return [read_triangles(folder / file)["a"] for file in ("a.stl", "a.3mf")]


@pytest.fixture(scope="module")
def tally():
    counted = Tally()
    yield counted
    counted.show("bodies with lines")


@pytest.mark.parametrize("seed", range(4))
def test_a_line_is_replaced_by_the_other_diagonal(tmp_path, seed):
    rng = np.random.default_rng(seed)
    box = box_surface([0, 0, 0], [64, 32, 16])
    surface = split_side(box, int(rng.integers(12)), int(rng.integers(3)), 0.25)
    assert count_lines(surface) == 1
    for triangles in written(tmp_path, surface):
        assert count_faults(triangles) == (0, 0)
        assert count_lines(as_surface(triangles)) == 0
        assert as_surface(triangles).volume == pytest.approx(box.volume, rel=1e-12)


def test_lines_are_replaced_in_any_closed_body(tmp_path, tally):
    for seed in range(VARIANTS):
        rng = np.random.default_rng(seed)
        surface = body_with_lines(rng, int(rng.integers(1, 12)))
        is_turned = rng.random() < 0.3
        if is_turned:  # corners are rounded off their lines
            q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            q *= np.sign(np.linalg.det(q))
            surface = Surface(surface.vertices @ q.T, surface.faces)
        tally.add(lambda s=surface, t=is_turned: check_written(tmp_path, s, t))


def check_written(folder, surface, is_turned):
    """Check that a surface is the same in its files but for its lines."""
    lines = 0
    for triangles in written(folder, surface):
        read = as_surface(triangles)
        assert count_faults(triangles) == (0, 0)
        assert len(read.faces) == len(surface.faces)
        assert len(read.vertices) == len(surface.vertices)
        assert read.volume == pytest.approx(surface.volume, rel=1e-5 if is_turned else 1e-12)
        assert np.abs(np.sort(read.bounds, axis=0) - surface.bounds).max() < 1e-4
        lines += count_lines(read)
    return "turned" if is_turned else "no lines" if not lines else "some lines left"


def test_surfaces_without_lines_and_open_ones_are_unchanged():
    box = box_surface([0, 0, 0], [64, 32, 16])
    assert replace_lines(box) is box.faces
    closed = split_side(box, 0, 0, 0.5)
    opened = Surface(closed.vertices, closed.faces[1:])
    assert (replace_lines(opened) == opened.faces).all()
    assert (replace_lines(closed) != closed.faces).any(axis=1).sum() == 2
