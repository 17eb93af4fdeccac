"""Solids of closed shells and loose faces, in variants of a few bodies.

DEFSENSE_VARIANTS sets how many; 100 and more are written as STEP and read back as well. `-s` shows
how many were read and refused.
"""

import os
from dataclasses import dataclass
from functools import cache

import build123d as bd
import numpy as np
import pytest
from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
from OCP.Interface import Interface_Static
from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer

from defsense_fab.core.errors import BodyError
from defsense_fab.geometry.bodies.cad_solid import make_cad_solid
from defsense_fab.geometry.kernels import brep, occ
from defsense_fab.geometry.kernels.stitching import STITCH_TOLERANCES_MM, collect_solids
from tests.support.tally import Tally

VARIANTS = int(os.environ.get("DEFSENSE_VARIANTS", "24"))
FORMS = ("solid", "shell", "faces", "open", "several", "with surface")


@cache
def bodies():
    rounded = bd.fillet(bd.Box(60, 30, 20).edges().filter_by(bd.Axis.Z), 4)
    return (
        bd.Box(60, 30, 20),
        rounded - bd.Cylinder(5, 20),
        bd.Cylinder(10, 50),
        bd.Sphere(15) + bd.Pos(0, 0, 20) * bd.Cone(8, 3, 30),
        bd.Torus(40, 8),
    )


@dataclass(frozen=True)
class Variant:
    """Shapes of one body.

    Attributes:
        form: One of FORMS.
        shapes: build123d shapes.
        volume: Volume of the body, mm^3; None if the shapes bound none.
        area: Area of the body, mm^2.
        gap: Largest displacement of faces from each other, mm.
    """

    form: str
    shapes: tuple
    volume: float | None
    area: float
    gap: float


def variant(number):
    """Return a variant; its number is the seed."""
    rng = np.random.default_rng(number)
    every, form = bodies(), FORMS[number % len(FORMS)]
    body = every[(number // len(FORMS)) % len(every)]
    body = bd.Pos(*rng.uniform(-50, 50, 3)) * bd.Rot(*rng.uniform(0, 360, 3)) * body
    solid, gap = body.solids()[0], 0.0
    if rng.random() < 0.5:
        solid = bd.Solid(solid.wrapped.Reversed())
    shapes, volume = [solid], body.volume
    if form == "shell":
        shapes = list(solid.shells())
    elif form in ("faces", "open"):
        faces = list(solid.faces())
        gap = float(rng.choice([0, 1e-4, 3e-3, 0.02, 0.5])) if len(faces) > 1 else 0.0
        shapes = [moved_copy(face, rng.uniform(-gap / 4, gap / 4, 3), rng) for face in faces]
        rng.shuffle(shapes)
        if form == "open" and len(shapes) > 2:
            del shapes[int(rng.integers(len(shapes)))]
            volume = None
        elif gap > 0.1:
            volume = None
    elif form == "several":
        shapes, volume = [solid, bd.Pos(200, 0, 0) * bd.Box(5, 5, 5)], None
    elif form == "with surface":
        shapes.append(bd.Pos(0, 0, 90) * bd.Face.make_rect(5, 5))
    return Variant(form, tuple(shapes), volume, body.area, gap)


def moved_copy(face, offset, rng):
    """Return a face with edges of its own, moved, and reversed by chance."""
    shape = BRepBuilderAPI_Copy((bd.Pos(*offset) * face).wrapped).Shape()
    return bd.Face(shape.Reversed() if rng.random() < 0.5 else shape)


def pieces(one):
    return [p for shape in one.shapes for p in brep.pieces_of(shape.wrapped)]


def through_step(one, path, unit):
    """Return the pieces of a STEP file of the shapes."""
    writer = STEPControl_Writer()
    Interface_Static.SetCVal_s("write.step.unit", unit)
    for shape in one.shapes:
        writer.Transfer(shape.wrapped, STEPControl_AsIs)
    writer.Write(str(path))
    Interface_Static.SetCVal_s("write.step.unit", "MM")
    return occ.read_step(path)


def outcome(one, shapes):
    """Return the code of the error, or check the body and return "read"."""
    try:
        solid, surface, notes = make_cad_solid(shapes, "x", (1, 1e4), 0.05, False, False)
    except BodyError as error:
        return error.code
    allowed = one.area * one.gap + 1e-6 * one.volume
    assert abs(occ.volume(solid) - one.volume) <= allowed
    assert surface.volume == pytest.approx(occ.volume(solid), rel=5e-3, abs=allowed)
    is_loose = one.form in ("faces", "open") and len(one.shapes) > 1
    assert any("stitched" in n for n in notes) == is_loose
    assert any("left out" in n for n in notes) == (one.form == "with surface")
    return "read"


@pytest.fixture(scope="module")
def tallies():
    """Count the outcomes of shapes as they are, and of the same in STEP files."""
    counted = {"shapes": Tally(), "STEP files": Tally()}
    yield counted
    for title, tally in counted.items():
        tally.show(title)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(VARIANTS))
def test_variants_are_read_right_or_refused(number, tmp_path, tallies):
    one = variant(number)
    expected = "read" if one.volume else "not-one-solid" if one.form == "several" else "no-solid"
    assert tallies["shapes"].add(lambda: outcome(one, pieces(one))) == expected
    if VARIANTS >= 100:
        path, unit = tmp_path / "a.step", ("MM", "INCH", "M")[number % 3]
        files = tallies["STEP files"]
        assert files.add(lambda: outcome(one, through_step(one, path, unit))) == expected


def test_a_closed_shell_in_step_is_a_solid(tmp_path):
    box = bd.Box(120, 30, 20)
    one = Variant("shell", tuple(box.shells()), box.volume, box.area, 0.0)
    shapes = through_step(one, tmp_path / "a.step", "MM")
    collected = collect_solids(shapes)
    assert [occ.volume(s) for s in collected.solids] == pytest.approx([72000.0])
    assert (collected.stitched, collected.surfaces) == (0, 0)


def test_the_smallest_tolerance_that_closes_is_reported():
    faces = list(bd.Box(60, 30, 20).faces())
    faces[0] = bd.Pos(0, 0, 0.005) * faces[0]
    collected = collect_solids([f.wrapped for f in faces])
    assert (collected.stitched, collected.tolerance) == (6, STITCH_TOLERANCES_MM[1])


def test_open_surfaces_are_refused_with_their_opening():
    top = max(bd.Box(60, 30, 20).faces(), key=lambda f: f.center().Z)
    faces = [f for f in bd.Box(60, 30, 20).faces() if f.center() != top.center()]
    with pytest.raises(BodyError) as caught:
        make_cad_solid([f.wrapped for f in faces], "x", (1, 1e4), 0.05, False, False)
    assert caught.value.data["surfaces"] == 5
    assert caught.value.data["at"][2] == pytest.approx(10)


def test_nothing_is_refused():
    with pytest.raises(BodyError) as caught:
        make_cad_solid([], "x", (1, 1e4), 0.05, False, False)
    assert (caught.value.code, caught.value.data["surfaces"]) == ("no-solid", 0)
