"""Organic bodies with defects are repaired, as measured by other means."""

import re

import numpy as np
import pytest

from defsense_fab.core.errors import BodyError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.repair.crossings import find_crossing_pairs
from defsense_fab.geometry.bodies.repair.mesh_repair import repair_mesh
from tests.conftest import box_surface
from tests.support.defective_bodies import (
    BODIES,
    creature,
    exact_winding,
    sampled_distance,
    volume_of,
)
from tests.support.errors import raises
from tests.support.surfaces import join

DETAIL = {"genus": 4, "overlap": 4}  # faceted so finely that they are their round originals
BOX = box_surface([0, 0, 0], [40, 20, 10])


def sound(v, f):
    """Closed and turned outward, every corner of one sheet, nothing crossed, winding numbers 0
    and 1."""
    directed = f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    edges, count = np.unique(directed, axis=0, return_counts=True)
    assert (count == 1).all()
    assert (np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)[1] == 2).all()
    assert not len(find_crossing_pairs(v, f))
    points = np.random.default_rng(0).uniform(v.min(0) - 2, v.max(0) + 2, (60, 3))
    winding = exact_winding(v, f, points)
    assert np.abs(winding - np.round(winding)).max() < 1e-6
    assert set(np.round(winding)) == {0, 1}


def reported_move(sentences):
    """The largest of the reported distances."""
    return max(
        float(x)
        for line in sentences
        for x in re.findall(r"moved (?:at most )?([\d.e-]+) mm", line)
    )


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.slow) if n in ("folds", "overlap", "genus") else n
     for n in BODIES if n not in ("crossings", "everything")],
)  # fmt: skip
def test_defects_are_repaired(name):
    body = BODIES[name](DETAIL.get(name, 3), 2)
    v, f, sentences = repair_mesh(body.vertices, body.faces, name, fill_cavities=True)
    sound(v, f)
    assert volume_of(v, f) == pytest.approx(body.volume, rel=0.01)
    assert sentences


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_repaired_crossings_move_the_surface_no_farther_than_reported(seed):
    body = BODIES["crossings"](3, seed)
    v, f, sentences = repair_mesh(body.vertices, body.faces, "x")
    sound(v, f)
    assert volume_of(v, f) == pytest.approx(body.volume, rel=0.01)
    reported = reported_move(sentences)
    assert sampled_distance((v, f), (body.vertices, body.faces), 5000) <= 1.05 * reported
    assert reported < 0.01 * np.linalg.norm(np.ptp(v, axis=0))
    place = re.search(r"in \d places?: \((.*?)\)", " ".join(sentences))[1]
    at = np.array([float(x) for x in place.split(",")])
    assert np.linalg.norm(body.vertices - at, axis=1).min() < 10


@pytest.mark.slow
def test_all_defects_at_once():
    body = BODIES["everything"](3, 0)
    v, f, _ = repair_mesh(body.vertices, body.faces, "x")
    sound(v, f)
    assert volume_of(v, f) == pytest.approx(body.volume, rel=0.01)


def test_missing_triangle_is_reported_as_a_hole_with_its_place():
    v, f, sentences = repair_mesh(BOX.vertices, BOX.faces[1:], "box")
    sound(v, f)
    assert volume_of(v, f) == pytest.approx(8000)
    assert len(sentences) == 1
    assert "3 edges" in sentences[0]
    assert "near (" in sentences[0]


def box(size, at, inward=False):
    """A box by its size and middle."""
    half = np.array(size) / 2
    surface = box_surface(np.array(at) - half, np.array(at) + half)
    return Surface(surface.vertices, surface.faces[:, ::-1]) if inward else surface


def repair(*surfaces, **options):
    """Repair several surfaces as one; return its vertices, faces and sentences."""
    whole = join(*surfaces)
    return repair_mesh(whole.vertices, whole.faces, "x", **options)


CAVITY = box([6, 5, 4], [20, 10, 5], inward=True)


def test_cavity_is_refused_or_filled():
    with raises(BodyError, "closed-cavity") as caught:
        repair(BOX, CAVITY)
    assert caught.value.data["volume"] == pytest.approx(120)
    assert caught.value.data["at"] == pytest.approx([20, 10, 5])
    v, f, sentences = repair(BOX, CAVITY, fill_cavities=True)
    assert volume_of(v, f) == pytest.approx(8000)
    assert len(sentences) == 1
    assert "120 mm3" in sentences[0]
    assert "(20, 10, 5)" in sentences[0]


def test_cavity_of_an_inside_out_body_is_detected():
    whole = join(BOX, CAVITY)
    with raises(BodyError, "closed-cavity") as caught:
        repair_mesh(whole.vertices, whole.faces[:, ::-1], "box")
    assert caught.value.data["volume"] == pytest.approx(120)


def test_pieces_are_reported_with_places_and_crumbs_dropped():
    with raises(BodyError, "separate-pieces", count=2) as caught:
        repair(BOX, box([4, 4, 4], [80, 0, 0]))
    assert caught.value.data["volumes"] == pytest.approx([8000, 64])
    np.testing.assert_allclose(caught.value.data["places"], [[20, 10, 5], [80, 0, 0]], atol=1e-9)
    v, f, sentences = repair(BOX, box([1, 1, 1], [80, 0, 0]))
    assert volume_of(v, f) == pytest.approx(8000)
    assert len(sentences) == 1
    assert "1 mm3" in sentences[0]
    assert "(80, 0, 0)" in sentences[0]


@pytest.mark.parametrize(
    ("other", "overlap"),
    [(box([20, 10, 6], [40, 10, 5]), "600 mm3"), (box([10, 10, 6], [20, 10, 13]), "0 mm3")],
    ids=["overlap", "touch in a face"],
)
def test_two_boxes_are_united(other, overlap):
    v, f, sentences = repair(BOX, other)
    sound(v, f)
    assert volume_of(v, f) == pytest.approx(8600)
    assert "2 shells" in sentences[0]
    assert overlap in sentences[0]


def test_boxes_that_share_a_wall_are_united():
    """Of each, a face is inside of the other's outline: an inner wall once they are merged."""
    v, f, sentences = repair(
        box_surface([0, 0, 0], [10, 10, 10]), box_surface([10, 0, 0], [25, 10, 10])
    )
    sound(v, f)
    assert volume_of(v, f) == pytest.approx(2500)
    assert any("2 triangles" in line or "4 triangles" in line for line in sentences)


def test_body_that_touches_itself_at_an_edge_is_separated():
    """A ring of cubes, of which the first and the last have one edge in common."""
    cubes = {(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 1)} - {(1, 1)}
    v, f, faces = [], [], {}
    for x, y in cubes:
        cube = box_surface([10 * x, 10 * y, 0], [10 * x + 10, 10 * y + 10, 10])
        for face in cube.faces:
            key = tuple(sorted(map(tuple, cube.vertices[face].round(6).tolist())))
            faces.setdefault(key, []).append(cube.vertices[face])
    walls = {k: c for k, c in faces.items() if len(c) == 1}
    for corners in walls.values():
        f.append([len(v), len(v) + 1, len(v) + 2])
        v += corners[0].tolist()
    v, f, sentences = repair_mesh(np.array(v), np.array(f), "ring")
    sound(v, f)
    assert volume_of(v, f) == pytest.approx(1000 * len(cubes), rel=0.01)
    assert reported_move(sentences) < 0.03


def test_sound_body_is_unchanged():
    v, f = creature(3)
    got_v, got_f, sentences = repair_mesh(v, f, "x")
    assert sentences == []
    order = np.lexsort(v.T[::-1])
    assert (got_v == v[order]).all()
    assert len(got_f) == len(f)


def fine(surface, times=3):
    """Each triangle split into four, several times."""
    import trimesh

    mesh = trimesh.Trimesh(surface.vertices, surface.faces)
    for _ in range(times):
        mesh = mesh.subdivide()
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


def test_soup_and_small_holes_and_turned_faces_are_repaired(bar):
    vertices, faces = fine(bar)
    faces = faces[1:].copy()
    faces[10] = faces[10][::-1]
    soup = vertices[faces].reshape(-1, 3)
    v, f, sentences = repair_mesh(soup, np.arange(len(soup)).reshape(-1, 3), "x.stl")
    assert Surface(v, f).volume == pytest.approx(bar.volume, rel=1e-9)
    assert len(sentences) == 3  # vertices merged, a hole closed, faces turned


def test_inside_out_is_turned(bar):
    v, f, sentences = repair_mesh(bar.vertices, bar.faces[:, ::-1], "x")
    assert Surface(v, f).volume == pytest.approx(135000)
    assert len(sentences) == 1


def test_a_wide_hole_is_refused_with_its_place(bar):
    with raises(BodyError, "hole-too-wide", edges=4) as caught:
        repair_mesh(bar.vertices, bar.faces[2:], "box.stl")
    assert "box.stl" in str(caught.value)


@pytest.mark.slow
def test_a_surface_that_passes_through_itself_is_refused_with_its_place(bar):
    """One end of the bar is folded back through its side."""
    vertices, faces = fine(bar)
    end = vertices[:, 0] > 120
    folded = vertices.copy()
    folded[end] += (vertices[end, :1] - 120) * np.array([-2.2, 0, 1.0])
    with raises(BodyError, "repair-moves-too-far") as caught:
        repair_mesh(folded, faces, "x")
    assert caught.value.data["distance"] == pytest.approx(30, rel=0.02)
    bent = vertices + np.where(end[:, None], (vertices[:, :1] - 120) * np.array([-0.4, 0, 1]), 0)
    assert repair_mesh(bent, faces, "x")[2] == []
