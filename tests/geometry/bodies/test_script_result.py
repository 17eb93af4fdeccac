"""What a body script returned: solids, shells and faces are taken, other objects named."""

import build123d as bd
import cadquery as cq
import pytest
import trimesh
from OCP.TopAbs import TopAbs_FACE, TopAbs_SHELL, TopAbs_SOLID

from defsense_fab.core.errors import BodyError
from defsense_fab.geometry.bodies.script_result import pieces_from_result
from tests.support.errors import raises


def empty_builder():
    with bd.BuildPart() as builder:
        pass
    return builder


def drawing():
    with bd.BuildSketch() as builder:
        bd.Rectangle(9, 9)
    return builder


def pair():
    """Return two solids of CadQuery in an assembly."""
    out = cq.Assembly().add(cq.Workplane().box(10, 3, 2))
    return out.add(cq.Workplane().box(1, 1, 1).translate((9, 0, 0)))


BOX = bd.Box(10, 3, 2)
PAIR = [BOX, bd.Pos(20, 0, 0) * bd.Box(1, 1, 1)]


@pytest.mark.parametrize(
    ("result", "kinds"),
    [
        (BOX, [TopAbs_SOLID]),
        ([BOX], [TopAbs_SOLID]),
        (BOX.solids(), [TopAbs_SOLID]),
        (BOX.shells(), [TopAbs_SHELL]),
        (BOX.faces(), [TopAbs_FACE] * 6),
        (bd.Sphere(4).faces()[0], [TopAbs_FACE]),
        (cq.Workplane().box(1, 1, 1), [TopAbs_SOLID]),
        (cq.Workplane().box(1, 1, 1).shells(), [TopAbs_SHELL]),
        (cq.Assembly().add(cq.Workplane().box(1, 1, 1)), [TopAbs_SOLID]),
    ],
)
def test_what_may_bound_a_body_is_taken(result, kinds):
    assert [piece.ShapeType() for piece in pieces_from_result(result)] == kinds


@pytest.mark.parametrize(
    ("result", "code", "data"),
    [
        (pair(), "not-one-solid", {"type": "Assembly", "count": 2}),
        (PAIR, "not-one-solid", {"type": "list", "count": 2}),
        (bd.Compound(children=list(PAIR)), "not-one-solid", {"type": "Compound", "count": 2}),
        (drawing(), "not-a-solid", {"type": "BuildSketch", "surfaces": 1}),
        (bd.Sketch() + bd.Circle(3), "not-a-solid", {"type": "Sketch", "surfaces": 1}),
        (BOX.faces()[:1], "not-a-solid", {"type": "ShapeList", "surfaces": 1}),
        (cq.Workplane().box(1, 1, 1).faces(">Z"), "not-a-solid", {"type": "Workplane"}),
        (cq.Workplane().pushPoints([(0, 0)]), "not-a-solid", {"type": "Workplane", "surfaces": 0}),
        (bd.Line((0, 0), (1, 1)), "not-a-solid", {"type": "Line", "surfaces": 0}),
        (empty_builder(), "not-a-solid", {"type": "BuildPart", "surfaces": 0}),
        (bd.Part(), "not-a-solid", {"type": "Part", "surfaces": 0}),
        (cq.Assembly(), "not-a-solid", {"type": "Assembly", "surfaces": 0}),
        ([], "not-a-solid", {"type": "list", "surfaces": 0}),
        ([BOX, 3], "not-a-solid", {"type": "list"}),
        (trimesh.creation.box((1, 1, 1)), "not-a-solid", {"type": "Trimesh"}),
        ({"body": BOX}, "not-a-solid", {"type": "dict"}),
    ],
)
def test_other_results_are_named_by_their_type(result, code, data):
    with raises(BodyError, code, **data) as caught:
        pieces_from_result(result)
    assert data["type"] in str(caught.value)
    assert caught.value.action


def test_an_assembly_is_fused_as_its_error_says():
    parts = pair().toCompound().Solids()
    (piece,) = pieces_from_result(parts[0].fuse(*[p.translate((-5, 0, 0)) for p in parts[1:]]))
    assert piece.ShapeType() == TopAbs_SOLID
