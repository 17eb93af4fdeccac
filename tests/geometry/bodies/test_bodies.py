"""Bodies that are repaired, and bodies that are refused."""

import numpy as np
import pytest

from defsense_fab.core.device.device import BodySpec
from defsense_fab.core.errors import BodyError, MeshingError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.body import load_body
from defsense_fab.geometry.bodies.mesh_repair import read_mesh, repair_mesh
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from defsense_fab.geometry.kernels import occ
from defsense_fab.geometry.printing.export import write_3mf, write_stl
from tests.support.errors import raises


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


def test_two_pieces_are_refused(bar):
    v = np.concatenate([bar.vertices, bar.vertices + 500])
    f = np.concatenate([bar.faces, bar.faces + len(bar.vertices)])
    with raises(BodyError, "separate-pieces", count=2):
        repair_mesh(v, f, "x")


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


def test_a_body_far_from_the_origin_is_refused(bar, tmp_path):
    path = tmp_path / "bar.stl"
    write_stl(Surface(bar.vertices + 60000, bar.faces), path)
    with raises(BodyError, "far-from-origin") as caught:
        load_body(BodySpec("mesh", path))
    assert caught.value.data["distance"] == pytest.approx(60150)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("kind", ["stl", "3mf", "obj"])
def test_mesh_files_round_trip(bar, tmp_path, kind):
    path = tmp_path / f"bar.{kind}"
    if kind == "stl":
        write_stl(bar, path)
    elif kind == "3mf":
        write_3mf({"bar": bar}, path, "bar")
    else:
        lines = ["v {} {} {}".format(*v) for v in bar.vertices]
        lines += ["f {} {} {}".format(*(f + 1)) for f in bar.faces]
        path.write_text("\n".join(lines))
    surface, _, _ = read_mesh(path, 2.0, (1, 1e4))
    assert surface.volume == pytest.approx(8 * 135000, rel=1e-6)


def test_3mf_units_and_transforms_count(bar, tmp_path):
    import lib3mf

    wrapper = lib3mf.get_wrapper()
    write_3mf({"bar": bar}, tmp_path / "a.3mf", "bar")
    model = wrapper.CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(tmp_path / "a.3mf"))
    model.SetUnit(lib3mf.ModelUnit.Inch)
    items = model.GetBuildItems()
    items.MoveNext()
    items.GetCurrent().SetObjectTransform(wrapper.GetUniformScaleTransform(2.0))
    model.QueryWriter("3mf").WriteToFile(str(tmp_path / "b.3mf"))
    surface, _, _ = read_mesh(tmp_path / "b.3mf", 1.0, (1, 1e5))
    assert surface.bounds == pytest.approx(50.8 * bar.bounds)


@pytest.mark.parametrize("scale", [1e-4, 1e3, 1e300])
def test_a_body_in_other_units_is_refused(bar, tmp_path, scale):
    write_stl(bar, tmp_path / "bar.stl")
    with raises(BodyError, "unlikely-size"):
        read_mesh(tmp_path / "bar.stl", scale, (1, 1e4))


def test_a_broken_file_is_one_line(tmp_path):
    (tmp_path / "bad.stl").write_bytes(b"not a mesh")
    with raises(BodyError, "no-triangles") as caught:
        read_mesh(tmp_path / "bad.stl", 1.0, (1, 1e4))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "code", "data"),
    [
        (
            "def body(length=1):\n    raise ValueError('too\\nshort')",
            "script-raises",
            {"line": 2, "exception": "ValueError", "message": "too short"},
        ),
        ("x = ", "script-raises", {"line": 1, "exception": "SyntaxError"}),
        ("\nimport no_such.thing", "library-missing", {"line": 2, "module": "no_such"}),
        (
            "raise ImportError('libGL.so.1: no such file', name='OCP.OCP')",
            "library-broken",
            {"line": 1, "module": "OCP.OCP"},
        ),
        ("import sys\nsys.exit(3)", "script-exits", {"line": 2}),
        (
            "import build123d as bd\ndef body(width=-5): return bd.Box(9, width, 9)",
            "script-raises",
            {"line": 2, "exception": "Standard_DomainError"},
        ),
        ("def body(): return None", "not-a-solid", {"type": "NoneType"}),
        ("def body(): return 3", "not-a-solid", {"type": "int"}),
        (
            "import build123d as bd\ndef body(): return bd.Box",
            "class-not-called",
            {"type": "Box"},
        ),
        (
            "class E(BaseException): pass\ndef body(): raise E('x')",
            "script-raises",
            {"line": 2, "exception": "E", "message": "x"},
        ),
        ("y = 1", "no-body-function", {}),
    ],
)
def test_scripts_that_fail_are_named_by_line(tmp_path, text, code, data):
    path = tmp_path / "body.py"
    path.write_text(text)
    with raises(BodyError, code, **data) as caught:
        load_body(BodySpec("script", path))
    assert str(path) in str(caught.value)
    if "line" in data:
        assert f"body.py:{data['line']}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_build123d_cadquery_and_step_agree(tmp_path):
    (tmp_path / "a.py").write_text(
        "import build123d as bd\ndef body(r=5.0): return bd.Box(40, 20, 20) - bd.Cylinder(r, 20)"
    )
    (tmp_path / "b.py").write_text(
        "import cadquery as cq\n"
        "def body(r=5.0): return cq.Workplane().box(40, 20, 20).faces('>Z').workplane().hole(2 * r)"
    )
    a = load_body(BodySpec("script", tmp_path / "a.py", {"r": 4.0}))
    b = load_body(BodySpec("script", tmp_path / "b.py", {"r": 4.0}))
    occ.write_step(a.solid, tmp_path / "c.step", "c")
    c = load_body(BodySpec("step", tmp_path / "c.step"))
    exact = 40 * 20 * 20 - np.pi * 16 * 20
    assert [x.volume for x in (a, b, c)] == pytest.approx([exact] * 3, rel=1e-6)
    assert a.surface.volume == pytest.approx(exact, rel=1e-3)


def test_edge_length_that_does_not_fit_is_refused(bar):
    with raises(MeshingError, "edge-too-short", edge_length=0.05):
        tetrahedralize(bar, 0.05)
    with raises(MeshingError, "edge-too-long", edge_length=500):
        tetrahedralize(bar, 500)


def test_mesh_invariants(bar_mesh, bar):
    assert bar_mesh.boundary().volume == pytest.approx(bar_mesh.volumes.sum())
    assert bar_mesh.volumes.sum() == pytest.approx(bar.volume, rel=5e-3)
