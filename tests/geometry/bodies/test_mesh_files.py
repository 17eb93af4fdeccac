"""Files of bodies: formats, units, damage, and names of other files."""

import json
import struct
import time

import meshio
import numpy as np
import pytest

from defsense_fab.core.device.device import BodySpec
from defsense_fab.core.errors import BodyError
from defsense_fab.geometry.bodies.body import load_body, read_body_file
from defsense_fab.geometry.bodies.mesh_files import detect_format, read_mesh
from defsense_fab.geometry.printing.export import write_stl
from tests.conftest import box_surface
from tests.support.body_fuzz import built, mutated, outcome
from tests.support.errors import raises

BOX = box_surface([0, 0, 0], [40, 20, 10])
SIZES = (1.0, 1e4)


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


def off(surface, head="OFF"):
    rows = [head, f"{len(surface.vertices)} {len(surface.faces)} 0"]
    rows += ["{} {} {}".format(*v) for v in surface.vertices]
    rows += ["3 {} {} {}".format(*f) for f in surface.faces]
    return "\n".join(rows).encode()


def gltf(surface, uri=None):
    """The tree and the buffer of a scene of one mesh in m with y upwards."""
    x, y, z = 1e-3 * surface.vertices.T
    points = np.stack([x, z, -y], axis=1).astype("<f4")
    indices = surface.faces.astype("<u4").tobytes()
    data = points.tobytes() + indices
    tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3",
             "min": points.min(0).tolist(), "max": points.max(0).tolist()},
            {"bufferView": 1, "componentType": 5125, "count": 3 * len(surface.faces),
             "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": points.nbytes},
                        {"buffer": 0, "byteOffset": points.nbytes, "byteLength": len(indices)}],
        "buffers": [{"byteLength": len(data)} | ({"uri": uri} if uri else {})],
    }  # fmt: skip
    return json.dumps(tree).encode(), data


def glb(surface):
    tree, data = gltf(surface)
    tree += b" " * (-len(tree) % 4)
    chunks = struct.pack("<I4s", len(tree), b"JSON") + tree
    chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def test_off_is_read_despite_another_suffix(tmp_path):
    path = tmp_path / "box.obj"
    path.write_bytes(b"# by hand\n" + off(BOX))
    assert detect_format(path.read_bytes()) == ".off"
    surface, notes, _ = read_mesh(path, 2.0, SIZES)
    assert surface.volume == pytest.approx(8 * 8000)
    assert len(notes) == 1
    assert "OFF" in notes[0]


def test_glb_is_converted_to_mm_with_z_up(tmp_path):
    path = tmp_path / "box.glb"
    path.write_bytes(glb(BOX))
    surface, notes, _ = read_mesh(path, 1.0, SIZES)
    assert surface.bounds == pytest.approx(BOX.bounds, abs=1e-5)
    assert surface.volume == pytest.approx(8000)
    assert len(notes) == 1
    assert read_mesh(path, 2.0, SIZES)[0].volume == pytest.approx(8 * 8000)


def test_gltf_that_names_other_files_is_refused(tmp_path):
    path = tmp_path / "box.gltf"
    path.write_bytes(gltf(BOX, "/dev/zero")[0])
    with raises(BodyError, "names-another-file"):
        read_mesh(path, 1.0, SIZES)


@pytest.mark.parametrize("kind", ["msh", "vtu", "mesh"])
def test_boundary_of_tetrahedra_is_read(kind, tmp_path):
    """Of two that share a face, one turned inside out."""
    points = np.array([[0, 0, 0], [30, 0, 0], [0, 30, 0], [0, 0, 30], [30, 30, 30]], float)
    tets = np.array([[0, 1, 2, 3], [4, 1, 2, 3]])
    path = tmp_path / f"a.{kind}"
    formats = {"msh": "gmsh", "vtu": "vtu", "mesh": "medit"}
    meshio.write(path, meshio.Mesh(points, [("tetra", tets)]), formats[kind])
    assert detect_format(path.read_bytes()) == f".{kind}"
    surface, _, _ = read_mesh(path, 1.0, SIZES)
    assert len(surface.faces) == 6
    assert surface.volume == pytest.approx(4500 + 9000)


def test_a_damaged_vtu_does_not_end_the_program(tmp_path):
    """Its reader calls sys.exit."""
    path = tmp_path / "a.vtu"
    path.write_text('<VTKFile type="UnstructuredGrid"><UnstructuredGrid/></VTKFile>')
    with raises(BodyError, "file-invalid", suffix=".vtu"):
        read_mesh(path, 1.0, SIZES)


@pytest.mark.parametrize("what", ["stl", "ply", "off"])
def test_false_counts_of_triangles_are_refused(what, tmp_path):
    path = tmp_path / f"a.{what}"
    content = {
        "stl": b"\0" * 80 + struct.pack("<I", 2**32 - 1) + b"\0" * 500,
        "ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\n"
        b"property float x\nproperty float y\nproperty float z\nelement face 4000000000\n"
        b"property list uchar int vertex_indices\nend_header\n" + b"\0" * 100,
        "off": b"OFF\n4000000000 4000000000 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    }[what]
    path.write_bytes(content)
    with raises(BodyError, "file-invalid" if what == "stl" else "file-truncated"):
        read_mesh(path, 1.0, SIZES)


def test_step_and_mesh_are_distinguished(tmp_path):
    (tmp_path / "a.stl").write_bytes(b"ISO-10303-21;\nHEADER;\nENDSEC;\n")
    with raises(BodyError, "wrong-file-format", suffix=".step"):
        read_mesh(tmp_path / "a.stl", 1.0, SIZES)
    (tmp_path / "a.step").write_bytes(off(BOX))
    with raises(BodyError, "wrong-file-format", suffix=".off"):
        load_body(BodySpec("step", tmp_path / "a.step"))


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
    surface, _, _ = read_mesh(path, 1.0, SIZES)
    assert surface.volume == pytest.approx(8000)
    (tmp_path / "box.ply").write_bytes(ply(BOX))
    assert read_mesh(tmp_path / "box.ply", 1.0, SIZES)[0].volume == pytest.approx(8000)


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


@pytest.mark.slow
def test_damaged_files_are_read_or_refused_in_one_line(tmp_path):
    files = mutated(60, 7)[::15]
    for k, (name, content) in enumerate(files):
        folder = tmp_path / str(k)
        folder.mkdir()
        assert outcome(built(name, content, folder, 300)) != "fault", name


@pytest.mark.parametrize("mark", [b"/**/", b"<!---->", b"# \n"])
def test_many_comments_do_not_delay_the_detection(mark):
    started_at = time.process_time()
    assert detect_format(mark * 400 + b"x") is None
    assert time.process_time() - started_at < 5


def test_text_in_utf_16_without_a_mark_is_recognized(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    assert detect_format(text.encode("utf-16-le")) == ".obj"
