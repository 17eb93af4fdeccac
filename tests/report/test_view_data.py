"""The data of the 3D view, decoded without its script."""

from __future__ import annotations

import base64
import json
import re
import zlib
from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.mesh import Surface
from defsense_fab.report.viewer.compact_data import decimate_faces, simplify_parts
from defsense_fab.report.viewer.scene import in_script, view3d
from tests.report.twisted_bar import BACK, FRONT, TOP, displaced, twisted_bar


@pytest.fixture(scope="module")
def bar(tmp_path_factory):
    return twisted_bar(tmp_path_factory.mktemp("build"))


@pytest.fixture(scope="module")
def scene(bar):
    return bar.scene()


class Reader:
    """Reads the arrays of a scene by their indices."""

    def __init__(self, scene):
        self.content, self._bytes = scene.content, zlib.decompress(base64.b64decode(scene.numbers))

    def array(self, place):
        kind, start, count = self.content["arrays"][place]
        return np.frombuffer(self._bytes, "<" + kind, count, start).astype(int)

    def points(self, place, sheets=1):
        """(sheets, n, 3) mm."""
        return np.moveaxis(self.array(place).reshape(3, sheets, -1), 0, 2) * self.content["step"]

    def faces(self, place):
        steps = self.array(place)
        return np.cumsum((steps >> 1) ^ -(steps & 1)).reshape(-1, 3)


def middle_of(bar):
    bounds = np.array([s.bounds for s in bar.parts.values()])
    return (bounds[:, 0].min(0) + bounds[:, 1].max(0)) / 2


def test_parts_have_their_places_in_the_device(bar, scene):
    read = Reader(scene)
    assert [p["name"] for p in read.content["parts"]] == [FRONT, BACK, TOP]
    for record, part in zip(read.content["parts"], bar.parts.values(), strict=True):
        vertices = read.points(record["places"])[0] + middle_of(bar)
        surface = Surface(vertices, read.faces(record["faces"]))
        assert surface.volume == pytest.approx(part.volume, rel=2e-3)
        assert surface.bounds == pytest.approx(part.bounds, abs=0.04)


def test_joints_open_along_their_normals_and_cords_follow_their_parts(scene):
    read = Reader(scene)
    ways = np.array([j["ways"] for j in read.content["joints"]])
    reach = 0.1 * read.content["size"]
    first = reach * np.array([[0, -1, 0], [0, 1, 0], [0, 0, 0]])
    second = reach * np.array([[0, 0, -1], [0, 0, -1], [0, 0, 1]])
    assert ways == pytest.approx(np.array([first, second]), abs=1e-4)
    followers = {t["name"]: t for t in read.content["followers"]}
    level = read.points(followers["level"]["opened"], 2)
    assert level[0] == pytest.approx(np.tile([0, reach, 0], (level.shape[1], 1)) / 2, abs=0.02)
    assert level[1] == pytest.approx(0, abs=0.02)  # between top and back
    upright = read.points(followers["upright"]["opened"], 2)
    assert upright[0] == pytest.approx(0, abs=0.02)
    assert upright[1] == pytest.approx(np.tile([0, 0, -reach], (upright.shape[1], 1)), abs=0.02)
    seat = read.points(followers["tag 3"]["opened"], 2)
    assert seat[1] == pytest.approx(np.tile([0, 0, reach], (4, 1)), abs=0.02)


def test_surface_and_cords_move_as_the_poses_prescribe(bar, scene):
    read = Reader(scene)
    names = [s["name"] for s in read.content["states"]]
    surface = read.content["surface"]
    rest = read.points(surface["places"])[0] + middle_of(bar)
    moved = read.points(surface["moved"], len(names))
    cord = next(t for t in read.content["followers"] if t["kind"] == "cord")
    path = read.points(cord["places"])[0] + middle_of(bar)
    carried = read.points(cord["moved"], len(names))
    weights = dict(zip(bar.errors.names, bar.errors.weights, strict=True))
    for k, name in enumerate(names):
        assert moved[k] == pytest.approx(displaced(rest, weights[name]), abs=0.02)
        assert carried[k] == pytest.approx(displaced(path, weights[name]), abs=0.1)
    off = read.points(surface["missed"], len(names)) / read.content["step"] * surface["missed_step"]
    assert off[names.index("twist@1")] == pytest.approx(
        np.tile([0, 0.8, 0], (len(rest), 1)), abs=0.01
    )


def test_poses_pass_through_the_states_on_their_path(scene):
    content = scene.content
    names = [s["name"] for s in content["states"]]
    poses = {p["name"]: ([names[s] for s in p["states"]], p["at"]) for p in content["poses"]}
    assert poses == {
        "twist": (["twist@0.5", "twist@1"], [0.5, 1]),
        "twist + bend": (["1*twist+1*bend"], [1]),
        "twist 50 % + bend": (["0.5*twist+1*bend"], [1]),
    }
    assert [p["held_out"] for p in content["poses"]] == [False, False, True]


def test_a_device_of_one_part_has_nothing_to_open(bar):
    whole = replace(bar, manifest=replace(bar.manifest, assembly=(), pins=()))
    content = whole.scene().content
    assert content["joints"] == []
    assert {t["kind"] for t in content["followers"]} == {"cord", "wire", "seat"}


def test_names_cannot_become_html(scene, bar):
    page = str(view3d(scene))
    scripts = re.findall(r"<script[^>]*>(.*?)</script>", page, re.DOTALL)
    content = json.loads(scripts[0])
    assert content["parts"][1]["name"] == BACK
    assert content["device"] == bar.device.name
    assert page.count("<script") == page.count("</script>") == 5
    assert "<!--" not in page
    assert "&" not in scripts[0]
    assert json.loads(in_script("\u2028<!--]]>&</ScRiPt>")) == "\u2028<!--]]>&</ScRiPt>"


def test_the_same_build_gives_the_same_bytes(bar, scene, tmp_path):
    assert view3d(twisted_bar(tmp_path).scene()) == view3d(scene)


def test_the_page_needs_no_network(scene):
    page = str(view3d(scene))
    assert not re.findall(r"""(?:src|href)\s*=\s*["']""", page.split("<script")[0])
    assert not re.findall(r"\bimport\s*\(|XMLHttpRequest\(\)\.open|navigator\.sendBeacon", page)
    script = page.split('<script type="module">')[1]
    imports = re.findall(r"""\b(?:from|import)\s*["']([^"']+)["']""", script)
    assert imports == ["./three.js"]


def test_the_page_has_the_license_of_three(scene):
    page = str(view3d(scene))
    assert page.count("This file contains three.js.") == 1
    assert "Permission is hereby granted, free of charge" in page


def ball(radius, around, along):
    """Return a closed ball."""
    a = np.linspace(0, 2 * np.pi, around, endpoint=False)
    b = np.linspace(0, np.pi, along + 2)[1:-1]
    ring = np.stack([np.cos(a), np.sin(a)], 1)
    rows = [np.column_stack([np.sin(t) * ring, np.full(around, np.cos(t))]) for t in b]
    vertices = radius * np.concatenate([*rows, [[0, 0, 1.0], [0, 0, -1.0]]])
    k, n, m = np.arange(around), around, along
    faces = [np.stack([np.full(n, n * m), k, (k + 1) % n], 1)]
    for r in range(m - 1):
        p, q = r * n + k, r * n + (k + 1) % n
        faces += [np.stack([p, p + n, q], 1), np.stack([q, p + n, q + n], 1)]
    last = (m - 1) * n
    faces.append(np.stack([np.full(n, n * m + 1), last + (k + 1) % n, last + k], 1))
    return Surface(vertices, np.concatenate(faces))


def test_a_body_of_many_triangles_is_simplified_within_a_tolerance():
    body = ball(50.0, 400, 130)  # 104,000 triangles
    (simplified,) = simplify_parts({"ball": body}, 100.0).values()
    assert len(simplified.faces) < 60_000
    assert simplified.volume == pytest.approx(body.volume, rel=5e-3)
    assert np.linalg.norm(simplified.vertices, axis=1) == pytest.approx(50.0, abs=0.4)


def test_an_open_part_is_not_simplified():
    open_part = Surface(np.eye(3), np.array([[0, 1, 2]]))
    (simplified,) = simplify_parts({"open": open_part}, 1.0).values()
    assert simplified.vertices[simplified.faces] == pytest.approx(
        open_part.vertices[open_part.faces]
    )


def test_a_surface_with_many_states_keeps_some_of_its_vertices():
    body = ball(50.0, 100, 60)
    assert decimate_faces(body, 10) is body.faces
    states = 115  # room for 2,000 vertices
    faces = decimate_faces(body, states)
    assert len(np.unique(faces)) <= 2_006
    assert Surface(body.vertices, faces).volume == pytest.approx(body.volume, rel=0.02)
