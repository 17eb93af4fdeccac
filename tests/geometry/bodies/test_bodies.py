"""Bodies of files and scripts that are read, and bodies that are refused."""

import numpy as np
import pytest

from defsense_fab.core.device.device import BodySpec
from defsense_fab.core.errors import BodyError
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies.body import load_body
from defsense_fab.geometry.bodies.mesh_files import read_mesh
from defsense_fab.geometry.kernels import occ
from defsense_fab.geometry.printing.export import write_3mf, write_stl
from tests.support.errors import raises


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
    with raises(BodyError, "file-invalid") as caught:
        read_mesh(tmp_path / "bad.stl", 1.0, (1, 1e4))
    assert "\n" not in str(caught.value)


@pytest.mark.slow
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
            "class Box: pass\ndef body(): return Box",
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


@pytest.mark.slow
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
