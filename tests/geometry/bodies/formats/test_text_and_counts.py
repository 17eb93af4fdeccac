"""Errors and notes of mesh files have their line, code and counts."""

import numpy as np
import pytest

from defsense_fab.core.errors import BodyError
from defsense_fab.geometry.bodies.formats.medit import read_medit
from defsense_fab.geometry.bodies.formats.obj import read_obj
from defsense_fab.geometry.bodies.formats.off import read_off
from defsense_fab.geometry.bodies.formats.ply import read_ply
from defsense_fab.geometry.bodies.formats.stl import RECORD, is_stl, read_stl
from tests.conftest import box_surface
from tests.support.errors import raises

BOX = box_surface([0, 0, 0], [40, 20, 10])
POINTS = "v 0 0 0\rv 9 0 0\rv 0 9 0\r"


def binary_stl(count, records=None, end=b""):
    corners = BOX.vertices[BOX.faces]
    data = np.zeros(len(corners), RECORD)
    data["corners"] = corners
    return b"\0" * 80 + np.uint32(count).tobytes() + data[:records].tobytes() + end


@pytest.mark.parametrize(
    ("text", "code", "line"),
    [
        ("v 1,5 0 0\r" + POINTS + "f 1 2 3", "decimal-comma", 1),
        (POINTS + "f 1 2 3\rfase 1 2 3", "file-invalid", 5),
        (POINTS + "\r# note\rf 1 2 9", "vertex-missing", 6),
        (POINTS + "f 1 \\\r 2 x", "not-a-number", 5),
        (POINTS + "f 1 2", "face-too-few-corners", 4),
        (POINTS + "f 1 2 1_0", "not-a-number", 4),
        (POINTS + "surf 0 1 0 1 1 2 3", "surface-not-triangles", 4),
    ],
)
def test_errors_of_obj_have_their_line(text, code, line):
    with raises(BodyError, code, line=line):
        read_obj(text.encode())


@pytest.mark.parametrize(
    ("text", "code", "line"),
    [
        ("OFF\n3 1 0\n0 0 0\n9 0 0\n0,5 9 0\n3 0 1 2\n", "decimal-comma", 5),
        ("# a\nOFF\n3 1 0\n0 0 0\n9 0 0\n0 9 0\n3 0 1 7\n", "vertex-missing", 7),
        ("OFF\n3 2 0\n0 0 0\n9 0 0\n0 9 0\n3 0 1 2\n", "file-truncated", 6),
        ("OFF\n3 1 0\n0 0 0\n9 0 0\n0 9 0\n3 0 1 2\n3 0 1 2\n", "too-many-faces", 7),
    ],
)
def test_errors_of_off_have_their_line(text, code, line):
    with raises(BodyError, code, line=line):
        read_off(text.encode())


def test_binary_off_is_refused_by_name():
    with raises(BodyError, "format-variant-unsupported"):
        read_off(b"OFF BINARY\n\0\0\0\3")


@pytest.mark.parametrize("count", [0, 2**32 - 1, 13, 5])
def test_binary_stl_of_a_wrong_count_is_read_by_its_length(count):
    content = binary_stl(count)
    assert is_stl(content)
    mesh = read_stl(content)
    assert len(mesh.faces) == len(BOX.faces)
    assert len(mesh.notes) == 1


@pytest.mark.parametrize("end", [b"\n", b"\0" * 200, b"made by a program" * 5])
def test_bytes_after_binary_stl_are_noted(end):
    content = binary_stl(len(BOX.faces), end=end)
    assert is_stl(content)
    mesh = read_stl(content)
    assert np.array_equal(mesh.vertices, BOX.vertices[BOX.faces].reshape(-1, 3))
    assert len(mesh.notes) == 1


def test_stl_that_is_cut_off_is_refused():
    count = len(BOX.faces)
    for records, end in ((count - 1, b""), (count - 1, b"\0" * 30)):
        with raises(BodyError, "file-truncated", held=count - 1, stated=count):
            read_stl(binary_stl(count, records, end))
    with raises(BodyError, "file-truncated"):
        read_stl(b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n")


def test_other_bytes_are_no_stl():
    rng = np.random.default_rng(0)
    for content in (rng.bytes(5000), b"\0" * 5000, bytes(range(256)) * 20):
        assert not is_stl(content)


def test_strips_of_ply_turn_every_other_triangle():
    head = "ply\nformat ascii 1.0\nelement vertex 5\n"
    head += "".join(f"property float {c}\n" for c in "xyz")
    head += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    text = head + "0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n8 0 1 2 3 -1 2 3 4\n"
    assert read_ply(text.encode()).faces.tolist() == [[0, 1, 2], [2, 1, 3], [2, 3, 4]]


def test_sections_of_medit_that_the_body_does_not_need_are_skipped():
    text = "MeshVersionFormatted 3\rDimension\t3 Vertices 3\r0 0 0 1 9 0 0 1 0 9 0 1\r"
    text += "Ridges 1\r1\rNormals 1 0 0 1 Triangles 1 1 2 3 7 End"
    points, cells = read_medit(text.encode())
    assert points.tolist() == [[0, 0, 0], [9, 0, 0], [0, 9, 0]]
    assert [(kind, corners.tolist()) for kind, corners in cells] == [("triangle", [[0, 1, 2]])]
