"""The OpenCascade kernel. Bodies and parts go through here; `specimen.py` models its own."""

from __future__ import annotations

import contextlib
import io
import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import build123d as bd
import numpy as np
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeSolid
from OCP.BRepClass3d import BRepClass3d
from OCP.BRepOffsetAPI import BRepOffsetAPI_MakePipe
from OCP.Message import Message
from OCP.TopAbs import TopAbs_SHELL, TopAbs_SOLID
from OCP.TopExp import TopExp_Explorer
from OCP.TopoDS import TopoDS

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.errors import BodyError, FabricationError
from ...core.mesh import Surface
from .canonical_facets import canonical
from .cutting_tools import CRUMB, Frustum, Prism, Tool, frame

# Cavities of an exact solid: closed shells within its outer one.


def cavities(solid: Any) -> list[tuple[float, Float]]:
    """Of a TopoDS_Solid: each cavity's volume (mm3) and centre (3,) mm, the largest first."""
    outer = BRepClass3d.OuterShell_s(solid)
    found = []
    walk = TopExp_Explorer(solid, TopAbs_SHELL)
    while walk.More():
        shell = TopoDS.Shell_s(walk.Current())
        if not shell.IsSame(outer):
            own = bd.Solid(BRepBuilderAPI_MakeSolid(shell).Solid())
            middle = own.center(bd.CenterOf.BOUNDING_BOX)
            found.append((abs(own.volume), np.array([middle.X, middle.Y, middle.Z])))
        walk.Next()
    return sorted(found, key=lambda c: -c[0])


def filled(solid: Any) -> Any:
    """The TopoDS_Solid within its outer shell."""
    return BRepBuilderAPI_MakeSolid(BRepClass3d.OuterShell_s(solid)).Solid()


#: Largest angle between neighbouring facets of a curved face, rad: 0.06 % of a circle's area.
ANGLE = 0.06
#: Largest distance of a channel's arcs (`core/curve_conversion.py`) from the path, mm.
PATH_TOLERANCE = 0.01
_LOST = 2e-3  # of the parts' volume
_MENDED = 1e-6  # share of the volume that a mended solid may differ by
_NOTHING = 1e-3  # mm^3
_STAMP = "1980-01-01T00:00:00"  # of STEP files
_USE = re.compile(rb"(NEXT_ASSEMBLY_USAGE_OCCURRENCE\(')\d+")
_NOT_ASCII = re.compile(rb"[\x80-\xff]+(?:\r?\n[\x80-\xff]+)*")  # lines end within a letter


def solids_of(result: Any) -> list[Any]:
    """TopoDS_Solids in what a script returned: a build123d or CadQuery object."""
    if isinstance(result, type):
        raise BodyError(
            f"body() returned the class {result.__name__}; call it to make a solid",
            code="class-not-called",
            type=result.__name__,
        )
    if hasattr(result, "vals") and callable(result.vals):  # a CadQuery Workplane
        shapes = [v.wrapped for v in result.vals() if hasattr(v, "wrapped")]
    elif hasattr(result, "part") and hasattr(result.part, "wrapped"):  # a BuildPart
        shapes = [result.part.wrapped]
    elif getattr(result, "wrapped", None) is not None:
        shapes = [result.wrapped]
    else:
        raise BodyError(
            f"body() returned {type(result).__name__}; return a build123d or CadQuery solid",
            code="not-a-solid",
            type=type(result).__name__,
        )
    solids: list[Any] = []
    for shape in shapes:
        walk = TopExp_Explorer(shape, TopAbs_SOLID)
        while walk.More():
            solids.append(TopoDS.Solid_s(walk.Current()))
            walk.Next()
    return solids


def read_step(path: Path) -> list[Any]:
    """TopoDS_Solids of a STEP file. Raises BodyError where it cannot be read."""
    Message.DefaultMessenger_s().ChangePrinters().Clear()  # what it says, the error says too
    try:
        return solids_of(bd.import_step(str(path)))
    except BodyError:
        raise
    except Exception as error:  # the reader raises bare exceptions of OCP
        text = " ".join(str(error).split()) or "no valid STEP file"
        raise BodyError(
            f"{path}: cannot be read as STEP: {text}", code="file-invalid", suffix=".step"
        ) from None


def write_step(solid: Any, path: Path, label: str) -> None:
    """A STEP file of one solid by name, in mm."""
    shape = bd.Solid(solid)
    shape.label = label
    _export(shape, path)


def write_assembly(solids: Mapping[str, Any], path: Path, label: str) -> None:
    """One STEP file with the named solids in place."""
    children = []
    for name, solid in solids.items():
        child = bd.Solid(solid)
        child.label = name
        children.append(child)
    _export(bd.Compound(label=label, children=children), path)


def _export(shape: Any, path: Path) -> None:
    """The same shape gives the same bytes at any time: OpenCascade stamps the time, and numbers the
    uses of parts on and on while the program runs. On a full disk it would say nothing of use, so
    it writes to memory. Names come out of it with each byte of their UTF-8 as a letter of its own,
    and are written as the standard asks for (ISO 10303-21, 6.4.3)."""
    written = io.BytesIO()
    bd.export_step(shape, written, timestamp=_STAMP)
    count = itertools.count(1)
    numbered = _USE.sub(lambda m: m[1] + str(next(count)).encode(), written.getvalue())
    path.write_bytes(_NOT_ASCII.sub(_escaped, numbered))


def _escaped(found: re.Match[bytes]) -> bytes:
    """Letters beyond ASCII in hexadecimal digits."""
    text = b"".join(found[0].split()).decode()
    with contextlib.suppress(UnicodeError):  # the file's own name is written as it should be
        text = text.encode("latin-1").decode()
    wide = max(map(ord, text)) >= 0x10000
    kind, coding = (b"X4", "utf-32-be") if wide else (b"X2", "utf-16-be")
    return b"\\%s\\%s\\X0\\" % (kind, text.encode(coding).hex().upper().encode())


def volume(solid: Any) -> float:
    """Of a TopoDS_Solid, mm^3."""
    return float(bd.Solid(solid).volume)


def size(solid: Any) -> float:
    """Diagonal of the bounding box, mm; NaN where there is none."""
    try:
        return float(bd.Solid(solid).bounding_box().diagonal)
    except Exception:  # OpenCascade's void box; its exceptions carry no common base
        return float("nan")


def tessellate(solid: Any, tolerance: float) -> Surface:
    """Closed triangle surface of a solid, no facet further than `tolerance` mm from it."""
    points, triangles = bd.Solid(solid).tessellate(tolerance, ANGLE)
    vertices = np.array([[p.X, p.Y, p.Z] for p in points], float)
    return Surface(*canonical(vertices, np.array(triangles, np.int64)))


def tube(
    plane: Plane, pieces: Float, ends: Float, before: float, after: float, diameter: float
) -> Any:
    """Round tube along arcs (n, 3, 2) mm of a plane, each by start, middle and end, lengthened by
    straight runs along the directions `ends` (2, 2) of its first and last point; a TopoDS_Solid.

    All its faces are tori and cylinders, whose cuts with the cord plane are exact. Along Bezier
    curves they are splines, which OCC cut wrongly or never ended.
    """
    world = plane.to_world(pieces)
    ends = ends @ plane.axes[:, :2].T
    first, last = ends / np.linalg.norm(ends, axis=1, keepdims=True)
    start, end = world[0, 0] - before * first, world[-1, 2] + after * last
    edges = [bd.Line(tuple(start), tuple(world[0, 0]))] if before > 1e-6 else []
    for a, middle, b in world:
        bow = float(np.linalg.norm(middle - (a + b) / 2))
        straight = bow < 1e-6 * float(np.linalg.norm(b - a))
        points = [tuple(p) for p in ((a, b) if straight else (a, middle, b))]
        edges.append(bd.Line(*points) if straight else bd.ThreePointArc(*points))
    if after > 1e-6:
        edges.append(bd.Line(tuple(world[-1, 2]), tuple(end)))
    # The circle's seam points along the normal: near the cord plane it would meet the cuts.
    frame = bd.Plane(origin=tuple(start), x_dir=tuple(plane.normal), z_dir=tuple(first))
    section = (frame * bd.Circle(diameter / 2)).face()
    try:
        pipe = BRepOffsetAPI_MakePipe(bd.Wire(edges).wrapped, section.wrapped)
        solid = bd.Solid(pipe.Shape())
        good = solid.is_valid and solid.volume > 0
    except Exception as error:  # OCP's own exceptions carry no common base
        text = " ".join(str(error).split()) or type(error).__name__
        raise FabricationError(
            f"the channel cannot be swept: {text}; smooth the path", code="cannot-sweep-channel"
        ) from None
    if not good:
        raise FabricationError(
            "the channel's solid is not valid; the path bends tighter than the channel's radius",
            code="cannot-sweep-channel",
        )
    return solid.wrapped


def solid_of(tool: Tool) -> Any:
    """A tool as a build123d solid."""
    if isinstance(tool, Frustum):
        along = tool.end - tool.start
        height = float(np.linalg.norm(along))
        axes = frame(along / height)
        low, high = tool.radii
        place = _located(tool.start, axes)
        if abs(low - high) < 1e-9:
            return bd.Solid.make_cylinder(low, height, place)
        return bd.Solid.make_cone(low, high, height, place)
    outline = bd.Wire.make_polygon([tuple(p) for p in _in_space(tool)])
    face = bd.Face(outline)
    return bd.Solid.extrude(face, bd.Vector(*(tool.height * tool.axes[:, 2])))


def _located(origin: Float, axes: Float) -> Any:
    return bd.Plane(origin=tuple(origin), x_dir=tuple(axes[:, 0]), z_dir=tuple(axes[:, 2]))


def _in_space(tool: Prism) -> Float:
    return np.asarray(tool.origin + tool.polygon @ tool.axes[:, :2].T)


def without(solid: Any, tools: Sequence[Tool]) -> Any:
    """A TopoDS_Solid with tools cut out. Raises FabricationError where it falls apart."""
    if not tools:
        return solid
    return one_solid(bd.Solid(solid).cut(*[solid_of(t) for t in tools]))


@dataclass(frozen=True)
class Knife:
    """One cut of the one piece whose centre of mass is nearest to `center` (3,) mm: through and
    through, or only the solids nearest to `taken` (each (3,) mm); of a limited cut, `region` are
    the prisms of what is cut off and of the lid."""

    plane: Plane
    center: Float
    taken: tuple[Float, ...] = ()
    region: tuple[Prism, Prism] | None = None


def carve_and_split(
    solid: Any, cutters: Sequence[Any], knives: Sequence[Knife], count: int, expected: float
) -> list[Any]:
    """Cut solids out of the body and divide it into `count` parts (TopoDS_Solids) whose volumes
    should add up to about `expected` mm^3, without crumbs.

    Raises FabricationError where OpenCascade loses a part or some volume on the way.
    """
    body, tools = bd.Solid(solid), [bd.Solid(t) for t in cutters]
    channels = _solids(tools[0].fuse(*tools[1:])) if len(tools) > 1 else tools

    def carved(pieces: list[Any]) -> list[Any]:
        return [s for p in pieces for s in _solids(p.cut(*channels)) if s.volume > CRUMB]

    for channels_first in (False, True):  # now and then one order fails where the other works
        made = (
            _divided(carved([body]), knives) if channels_first else carved(_divided([body], knives))
        )
        if len(made) == count and abs(sum(p.volume for p in made) / expected - 1) < _LOST:
            return [p.wrapped for p in made]
    raise FabricationError(
        "OpenCascade could not divide the solid; move a cord plane slightly",
        code="cannot-divide-solid",
    )


def _divided(parts: list[Any], knives: Sequence[Knife]) -> list[Any]:
    """The solids after planar cuts; a cut that fails leaves its piece whole."""
    for knife in knives:
        nearest = _nearest(parts, knife.center)
        plane = _located(knife.plane.origin, knife.plane.axes)
        try:
            halves = _solids(bd.split(nearest, bisect_by=plane, keep=bd.Keep.BOTH))
        except ValueError:  # the splitter's result was null
            continue
        if knife.region is not None:
            halves = _solids(nearest & solid_of(knife.region[0]))
        if knife.taken and halves:
            taken = [_nearest(halves, at) for at in knife.taken]
            rest = _solids(nearest.cut(*taken))
            if knife.region is not None:
                taken = [s for t in taken for s in _solids(t & solid_of(knife.region[1]))]
            halves = taken + rest
        if halves:
            parts = [p for p in parts if p is not nearest] + halves
    return parts


def _nearest(solids: Sequence[Any], at: Float) -> Any:
    return min(solids, key=lambda p: float(np.linalg.norm(centroid(p.wrapped) - at)))


def _solids(result: Any) -> list[Any]:
    """The solids in what a boolean operation gave: a shape, a list of them, or nothing; without
    the empty ones that it leaves at times."""
    if result is None:
        return []
    found = result if isinstance(result, list | tuple | bd.ShapeList) else [result]
    return [s for r in found for s in r.solids() if s.volume > _NOTHING]


def centroid(solid: Any) -> Float:
    """Of a TopoDS_Solid, (3,) mm."""
    c = bd.Solid(solid).center(bd.CenterOf.MASS)
    return np.array([c.X, c.Y, c.Z])


def one_solid(shape: Any) -> Any:
    """The TopoDS_Solid that a build123d shape consists of; faults that boolean operations leave at
    times (edges that miss their surface by more than their tolerance) are mended. Raises
    FabricationError where it is not one valid solid."""
    solids = list(shape.solids())
    if len(solids) != 1 or solids[0].volume <= 0:
        raise FabricationError(
            f"the geometry kernel made {len(solids)} solids of one part",
            code="not-one-solid",
            count=len(solids),
        )
    solid = solids[0]
    if not solid.is_valid:
        mended = solid.fix()
        if not mended.is_valid or abs(mended.volume / solid.volume - 1) > _MENDED:
            raise FabricationError(
                "the geometry kernel made a solid of one part that is not valid",
                code="solid-invalid",
            )
        solid = mended
    return solid.wrapped
