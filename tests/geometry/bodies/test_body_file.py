"""Body files are detected from their content and read in a child process."""

from __future__ import annotations

import pytest

from defsense_fab.core.errors import BodyError
from defsense_fab.geometry.bodies.body_file import read_body_file
from defsense_fab.geometry.bodies.mesh_files import detect_format
from defsense_fab.geometry.bodies.mesh_repair import read_mesh
from defsense_fab.geometry.printing.export import write_stl
from tests.conftest import box_surface
from tests.support.errors import raises

BOX = box_surface([0, 0, 0], [40, 20, 10])


def obj(surface, head=""):
    rows = [f"v {x} {y} {z}" for x, y, z in surface.vertices]
    rows += ["f " + " ".join(str(i + 1) for i in face) for face in surface.faces]
    return (head + "\n".join(rows) + "\n").encode()


def ply(surface):
    head = (
        f"ply\nformat ascii 1.0\nelement vertex {len(surface.vertices)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(surface.faces)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    rows = [f"{x} {y} {z}" for x, y, z in surface.vertices]
    rows += ["3 " + " ".join(map(str, face)) for face in surface.faces]
    return (head + "\n".join(rows) + "\n").encode()


def test_formats_are_detected_from_content(tmp_path):
    write_stl(BOX, tmp_path / "box.stl")
    assert detect_format((tmp_path / "box.stl").read_bytes()) == ".stl"
    assert detect_format(b"solid x\nfacet normal 0 0 1\n") == ".stl"
    assert detect_format(obj(BOX)) == ".obj"
    assert detect_format(ply(BOX)) == ".ply"
    assert detect_format(b"/* by a program */\nISO-10303-21;\nHEADER;") == ".step"
    assert detect_format(b"PK\x03\x04....3D/3dmodel.model") == ".3mf"
    for other in (b"", b"solid ground", b"\x89PNG\r\n", b"import os\n", b"PK\x03\x04word/",
                  b"\0" * 84,
                  b"<html>v 1 2 3 f 1 2 3"):  # fmt: skip
        assert detect_format(other) is None, other


def test_material_files_are_not_read(tmp_path):
    """A material is a file that the mesh names: /dev/zero never ends."""
    path = tmp_path / "box.obj"
    path.write_bytes(obj(BOX, "mtllib /dev/zero\nusemtl all\n"))
    surface, _, _ = read_mesh(path, 1.0, (1, 1e4))
    assert surface.volume == pytest.approx(8000)
    (tmp_path / "box.ply").write_bytes(ply(BOX))
    assert read_mesh(tmp_path / "box.ply", 1.0, (1, 1e4))[0].volume == pytest.approx(8000)


@pytest.mark.slow
def test_file_of_unknown_unit_is_read_and_broken_one_refused(tmp_path):
    path = tmp_path / "box.obj"
    path.write_bytes(obj(BOX))
    body = read_body_file(path)
    assert body.surface.volume == pytest.approx(8000)
    path.write_bytes(obj(BOX).replace(b"f 1", b"f 999", 1))
    with pytest.raises(BodyError) as caught:
        read_body_file(path)
    assert str(caught.value).startswith("box.obj: ")  # without its folder
    step = tmp_path / "box.step"
    step.write_bytes(b"ISO-10303-21;\nHEADER;\nnonsense")
    with raises(BodyError, "file-invalid") as caught:
        read_body_file(step)
    assert str(caught.value).startswith("box.step: ")


@pytest.mark.slow
def test_reading_that_takes_too_long_ends(tmp_path):
    path = tmp_path / "box.obj"
    path.write_bytes(obj(BOX))
    with raises(BodyError, "time-limit-exceeded", limit=0.01):
        read_body_file(path, limit=0.01)
