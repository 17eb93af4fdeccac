"""Bodies: what is repaired, and what is refused."""

import numpy as np
import pytest

from defsense_fab.core.device.device import BodySpec
from defsense_fab.core.errors import BodyError, MeshingError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.body import load_body
from defsense_fab.geometry.bodies.mesh_repair import read_mesh, repair
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralise
from defsense_fab.geometry.kernels import occ
from defsense_fab.geometry.kernels.export import write_3mf, write_stl


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
    v, f, done = repair(soup, np.arange(len(soup)).reshape(-1, 3), "x.stl")
    assert Surface(v, f).volume == pytest.approx(bar.volume, rel=1e-9)
    assert any("merged" in d for d in done)
    assert any("closed 1" in d for d in done)
    assert any("turned" in d for d in done)


def test_inside_out_is_turned(bar):
    v, f, done = repair(bar.vertices, bar.faces[:, ::-1], "x")
    assert Surface(v, f).volume == pytest.approx(135000)
    assert done == ["turned the surface inside out"]


def test_a_wide_hole_is_refused_with_its_place(bar):
    with pytest.raises(BodyError, match=r"box\.stl: a hole .* mm wide .* close it"):
        repair(bar.vertices, bar.faces[2:], "box.stl")


def test_two_pieces_are_refused(bar):
    v = np.concatenate([bar.vertices, bar.vertices + 500])
    f = np.concatenate([bar.faces, bar.faces + len(bar.vertices)])
    with pytest.raises(BodyError, match="2 separate pieces"):
        repair(v, f, "x")


def test_a_surface_that_passes_through_itself_is_refused_with_its_place(bar):
    """One end of the bar is folded back through its side."""
    vertices, faces = fine(bar)
    end = vertices[:, 0] > 120
    folded = vertices.copy()
    folded[end] += (vertices[end, :1] - 120) * np.array([-2.2, 0, 1.0])
    with pytest.raises(BodyError, match=r"x: the surface passes .* at \(.*would move it by 30 mm"):
        repair(folded, faces, "x")
    bent = vertices + np.where(end[:, None], (vertices[:, :1] - 120) * np.array([-0.4, 0, 1]), 0)
    assert repair(bent, faces, "x")[2] == []


def test_a_body_far_from_the_origin_is_refused(bar, tmp_path):
    path = tmp_path / "bar.stl"
    write_stl(Surface(bar.vertices + 60000, bar.faces), path)
    with pytest.raises(BodyError, match=r"bar.stl: the body reaches 60.1 m away from the origin"):
        load_body(BodySpec("mesh", path))


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
    with pytest.raises(BodyError, match=r"mm across; set \[body\] scale"):
        read_mesh(tmp_path / "bar.stl", scale, (1, 1e4))


def test_a_broken_file_is_one_line(tmp_path):
    (tmp_path / "bad.stl").write_bytes(b"not a mesh")
    with pytest.raises(BodyError, match=r"bad\.stl") as caught:
        read_mesh(tmp_path / "bad.stl", 1.0, (1, 1e4))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "def body(length=1):\n    raise ValueError('too\\nshort')",
            r"body\.py:2: .* ValueError: too short",
        ),
        ("x = ", r"body\.py:1: the script raised SyntaxError"),
        (
            "\nimport no_such.thing",
            r"body\.py:2: needs the package no_such, which is not installed",
        ),
        (
            "raise ImportError('libGL.so.1: no such file', name='OCP.OCP')",
            r"body\.py:1: needs the package OCP, whose import fails \(libGL.so.1: no .*doctor",
        ),
        ("import sys\nsys.exit(3)", r"body\.py:2: the script ends the program \(3\) in place of"),
        (
            "import build123d as bd\ndef body(width=-5): return bd.Box(9, width, 9)",
            r"body\.py:2: .* takes no size that is zero or negative",
        ),
        ("def body(): return None", "returned None"),
        ("def body(): return 3", r"body\.py: body\(\) returned int"),
        ("import build123d as bd\ndef body(): return bd.Box", "returned the class Box"),
        ("class E(BaseException): pass\ndef body(): raise E('x')", r"body\.py:2: .* E: x"),
        ("y = 1", "defines no function body"),
    ],
)
def test_scripts_that_fail_are_named_by_line(tmp_path, text, message):
    path = tmp_path / "body.py"
    path.write_text(text)
    with pytest.raises(BodyError, match=message) as caught:
        load_body(BodySpec("script", path))
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
    with pytest.raises(MeshingError, match=r"use .* mm or more"):
        tetrahedralise(bar, 0.05)
    with pytest.raises(MeshingError, match="more than the body's size"):
        tetrahedralise(bar, 500)


def test_mesh_invariants(bar_mesh, bar):
    assert bar_mesh.boundary().volume == pytest.approx(bar_mesh.volumes.sum())
    assert bar_mesh.volumes.sum() == pytest.approx(bar.volume, rel=5e-3)
