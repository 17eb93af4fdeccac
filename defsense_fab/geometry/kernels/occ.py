"""Use the OpenCascade kernel: read, write, tessellate, sweep, cut and divide exact solids."""

from __future__ import annotations

import contextlib
import io
import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import build123d as bd
import numpy as np
from OCP.BRepBuilderAPI import BRepBuilderAPI_Copy
from OCP.BRepOffsetAPI import BRepOffsetAPI_MakePipe
from OCP.BRepTools import BRepTools
from OCP.Message import Message

from ...core.arrays import Float
from ...core.curve import Plane
from ...core.errors import BodyError, FabricationError
from ...core.mesh import Surface
from .brep import pieces_of
from .canonical_facets import canonicalize
from .cutting_tools import MIN_PIECE_MM3, Frustum, Prism, Tool, axes_from_normal

#: Largest angle between neighboring facets of a curved face: 0.06 % of a circle's area.
FACET_ANGLE_RAD = 0.06
#: Number of facets above which curved faces get larger ones, up to this angle.
MAX_FINE_FACETS, COARSE_FACET_ANGLE_RAD = 24_000, 0.12
#: Largest difference of the volume within the larger facets, as a share of the solid's: parts of
#: both kernels may differ by 2e-3 (`exact_solids.PART_TOLERANCE`).
MAX_FACET_LOSS = 1.5e-3
#: Largest distance of a channel's arcs (`core/curve_conversion.py`) from the path, mm.
PATH_TOLERANCE_MM = 0.01
MAX_VOLUME_LOSS = 2e-3  # share of the parts' volume
MAX_HEALING_CHANGE = 1e-6  # share of the volume by which a healed solid may differ
MIN_VOLUME_MM3 = 1e-3
STEP_TIMESTAMP = "1980-01-01T00:00:00"  # of STEP files
USE_NUMBER_PATTERN = re.compile(rb"(NEXT_ASSEMBLY_USAGE_OCCURRENCE\(')\d+")
NON_ASCII_PATTERN = re.compile(
    rb"[\x80-\xff]+(?:\r?\n[\x80-\xff]+)*"
)  # a line may end within a letter


def read_step(path: Path) -> list[Any]:
    """Return the pieces of a STEP file: its TopoDS_Solids, and surfaces outside solids.

    Raises:
        BodyError: If the file is not valid STEP.
    """
    Message.DefaultMessenger_s().ChangePrinters().Clear()  # the error repeats its messages
    try:
        return pieces_of(bd.import_step(str(path)).wrapped)
    except Exception as error:  # the reader raises bare exceptions of OCP
        raise BodyError(
            "is not a valid STEP file, or it is damaged",
            code="file-invalid",
            where=path,
            action="Export it again from the program that made it",
            suffix=".step",
        ) from error


def write_step(solid: Any, path: Path, label: str) -> None:
    """Write a STEP file of one TopoDS_Solid, in mm, named `label`."""
    shape = bd.Solid(solid)
    shape.label = label
    _export(shape, path)


def write_assembly(solids: Mapping[str, Any], path: Path, label: str) -> None:
    """Write one STEP file with named TopoDS_Solids in place, in mm."""
    children = []
    for name, solid in solids.items():
        child = bd.Solid(solid)
        child.label = name
        children.append(child)
    _export(bd.Compound(label=label, children=children), path)


def _export(shape: Any, path: Path) -> None:
    """Write a shape so that the same shape gives the same bytes at any time.

    OpenCascade stamps the time and numbers the uses of parts on while the program runs. On a full
    disk it would report nothing useful, so it writes to memory. It writes each byte of a name's
    UTF-8 as a letter; names are encoded as the standard requires (ISO 10303-21, 6.4.3).
    """
    buffer = io.BytesIO()
    bd.export_step(shape, buffer, timestamp=STEP_TIMESTAMP)
    count = itertools.count(1)
    numbered = USE_NUMBER_PATTERN.sub(lambda m: m[1] + str(next(count)).encode(), buffer.getvalue())
    path.write_bytes(NON_ASCII_PATTERN.sub(_escape, numbered))


def _escape(match: re.Match[bytes]) -> bytes:
    """Return letters beyond ASCII as hexadecimal digits."""
    text = b"".join(match[0].split()).decode()
    with contextlib.suppress(UnicodeError):  # only the file's own name is encoded correctly
        text = text.encode("latin-1").decode()
    is_wide = max(map(ord, text)) >= 0x10000
    kind, coding = (b"X4", "utf-32-be") if is_wide else (b"X2", "utf-16-be")
    return b"\\%s\\%s\\X0\\" % (kind, text.encode(coding).hex().upper().encode())


def volume(solid: Any) -> float:
    """Return the volume of a TopoDS_Solid, mm^3."""
    return float(bd.Solid(solid).volume)


def size(solid: Any) -> float:
    """Return the diagonal of the bounding box, mm; NaN if there is none."""
    try:
        return float(bd.Solid(solid).bounding_box().diagonal)
    except Exception:  # for an empty box; OpenCascade's have no common base
        return float("nan")


def tessellate(solid: Any, tolerance: float) -> Surface:
    """Return the closed triangle surface of a solid, with no facet farther than `tolerance` mm from
    it.

    Facets that would be more than `MAX_FINE_FACETS` are larger, if the volume stays accurate.
    """
    surface = _facets(solid, tolerance, FACET_ANGLE_RAD)
    if len(surface.faces) <= MAX_FINE_FACETS:
        return surface
    BRepTools.Clean_s(solid)  # facets are stored in the solid, and finer ones would be used again
    coarse = _facets(solid, tolerance, COARSE_FACET_ANGLE_RAD)
    exact = volume(solid)
    if abs(coarse.volume - exact) <= MAX_FACET_LOSS * exact:
        return coarse
    BRepTools.Clean_s(solid)
    return surface


def _facets(solid: Any, tolerance: float, angle: float) -> Surface:
    points, triangles = bd.Solid(solid).tessellate(tolerance, angle)
    vertices = np.array([[p.X, p.Y, p.Z] for p in points], float)
    return Surface(*canonicalize(vertices, np.array(triangles, np.int64)))


def tube(
    plane: Plane, pieces: Float, ends: Float, before: float, after: float, diameter: float
) -> Any:
    """Sweep a round tube along planar arcs.

    All faces are tori and cylinders, whose cuts with the cord plane are exact. Along Bezier curves
    they would be splines, which OpenCascade cut wrongly or without end.

    Args:
        plane: Plane of the arcs.
        pieces: Arcs (n, 3, 2), each by start, middle and end, mm.
        ends: Directions (2, 2) at the first and last point.
        before: Length of a straight run before the first point, mm.
        after: Length of a straight run after the last point, mm.
        diameter: Diameter, mm.

    Returns:
        A TopoDS_Solid.

    Raises:
        FabricationError: If the sweep fails.
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
    plane_at_start = bd.Plane(origin=tuple(start), x_dir=tuple(plane.normal), z_dir=tuple(first))
    section = (plane_at_start * bd.Circle(diameter / 2)).face()
    try:
        pipe = BRepOffsetAPI_MakePipe(bd.Wire(edges).wrapped, section.wrapped)
        solid = bd.Solid(pipe.Shape())
        is_valid = solid.is_valid and solid.volume > 0
    except Exception as error:  # OCP's exceptions have no common base
        raise FabricationError(
            "OpenCascade could not sweep the channel along its path",
            code="cannot-sweep-channel",
            action="Smooth the path",
        ) from error
    if not is_valid:
        raise FabricationError(
            "the channel's solid is not valid: the path bends tighter than the channel's radius",
            code="cannot-sweep-channel",
            action="Smooth the path",
        )
    return solid.wrapped


def solid_of(tool: Tool) -> Any:
    """Return a tool as a build123d solid."""
    if isinstance(tool, Frustum):
        along = tool.end - tool.start
        height = float(np.linalg.norm(along))
        axes = axes_from_normal(along / height)
        low, high = tool.radii
        location = _located(tool.start, axes)
        if abs(low - high) < 1e-9:
            return bd.Solid.make_cylinder(low, height, location)
        return bd.Solid.make_cone(low, high, height, location)
    outline = bd.Wire.make_polygon([tuple(p) for p in _in_space(tool)])
    face = bd.Face(outline)
    return bd.Solid.extrude(face, bd.Vector(*(tool.height * tool.axes[:, 2])))


def _located(origin: Float, axes: Float) -> Any:
    return bd.Plane(origin=tuple(origin), x_dir=tuple(axes[:, 0]), z_dir=tuple(axes[:, 2]))


def _in_space(tool: Prism) -> Float:
    return np.asarray(tool.origin + tool.polygon @ tool.axes[:, :2].T)


def cut_out(solid: Any, tools: Sequence[Tool]) -> Any:
    """Return a TopoDS_Solid with tools cut out.

    Raises:
        FabricationError: If it falls apart.
    """
    if not tools:
        return solid
    copy = BRepBuilderAPI_Copy(solid).Shape()  # a cut changes its operands even where it fails
    try:
        return as_one_solid(bd.Solid(solid).cut(*[solid_of(t) for t in tools]))
    except Exception:  # OCP's have no common base
        with bd.SkipClean():  # joining faces after the operation destroys some solids
            return as_one_solid(bd.Solid(copy).cut(*[solid_of(t) for t in tools]))


@dataclass(frozen=True)
class Knife:
    """One planar cut of one piece.

    Attributes:
        plane: Plane of the cut.
        center: Point (3,) nearest to the center of mass of the piece to cut, mm.
        taken: Centers of mass (3,) of the solids that come off; empty for a cut right through.
        region: For a limited cut, the prisms that bound the cut-off solid and the lid, else None.
    """

    plane: Plane
    center: Float
    taken: tuple[Float, ...] = ()
    region: tuple[Prism, Prism] | None = None


def carve_and_split(
    solid: Any, cutters: Sequence[Any], knives: Sequence[Knife], count: int, expected: float
) -> list[Any]:
    """Cut solids out of a body and divide it into parts.

    Args:
        solid: The body's TopoDS_Solid.
        cutters: TopoDS_Solids to cut out.
        knives: Planar cuts, in order.
        count: Expected number of parts.
        expected: Expected volume of all parts, mm^3.

    Returns:
        The parts (TopoDS_Solids), without crumbs.

    Raises:
        FabricationError: If OpenCascade loses a part or some volume.
    """
    copies = [BRepBuilderAPI_Copy(shape).Shape() for shape in (solid, *cutters)]
    for joins_faces, channels_first in _ATTEMPTS:
        body, *tools = (solid, *cutters) if joins_faces else copies
        divisions = _channels_first if channels_first else _channels_last
        with contextlib.nullcontext() if joins_faces else bd.SkipClean():
            for parts in divisions(bd.Solid(body), [bd.Solid(t) for t in tools], knives):
                if (
                    len(parts) == count
                    and abs(sum(p.volume for p in parts) / expected - 1) < MAX_VOLUME_LOSS
                    and (joins_faces or all(p.is_valid for p in parts))
                ):
                    return [p.wrapped for p in parts]
    raise FabricationError(
        "OpenCascade could not divide the solid",
        code="cannot-divide-solid",
        action="Move a cord plane slightly",
    )


#: Whether faces are joined after each operation (see `cut_out`), and whether channels are cut out
#: before the body is divided. Each way sometimes fails where another works; the fastest is first.
_ATTEMPTS = ((True, False), (False, True), (True, True), (False, False))
#: Where a channel's axis is exactly in a part's face, the kernel sometimes ignores the channel.
#: It does not if the channel is moved by less than anyone can measure.
_SHIFT_MM = bd.Location((4e-5, 6e-5, 7e-5))


def _channels_last(body: Any, tools: Sequence[Any], knives: Sequence[Knife]) -> Iterator[list[Any]]:
    """Yield the parts of a body that is divided before channels are cut out, in two ways."""
    try:
        pieces = _divide([body], knives)
        channels = _solids(tools[0].fuse(*tools[1:])) if len(tools) > 1 else list(tools)
        yield _carve(pieces, channels)
        yield _carve(pieces, [c.moved(_SHIFT_MM) for c in channels])
    except Exception:  # OCP's have no common base
        return


def _channels_first(
    body: Any, tools: Sequence[Any], knives: Sequence[Knife]
) -> Iterator[list[Any]]:
    """Yield the parts of a body that is divided after channels are cut out."""
    try:
        yield _divide(_carve([body], tools), knives)
    except Exception:  # OCP's have no common base
        return


def _carve(pieces: Sequence[Any], channels: Sequence[Any]) -> list[Any]:
    return [s for p in pieces for s in _solids(p.cut(*channels)) if s.volume > MIN_PIECE_MM3]


def _divide(parts: list[Any], knives: Sequence[Knife]) -> list[Any]:
    """Return the solids after planar cuts; a cut that fails leaves its piece whole."""
    for knife in knives if parts else ():
        nearest = _nearest(parts, knife.center)
        if knife.region is not None:
            halves = _solids(nearest & solid_of(knife.region[0]))
        else:
            plane = _located(knife.plane.origin, knife.plane.axes)
            try:
                halves = _solids(bd.split(nearest, bisect_by=plane, keep=bd.Keep.BOTH))
            except ValueError:  # the splitter's result was null
                continue
        if knife.taken and halves:
            taken = [_nearest(halves, at) for at in knife.taken]
            rest = [h for h in halves if h not in taken]
            if knife.region is not None or not _lie_apart(rest, taken, knife.plane):
                rest = _solids(nearest.cut(*taken))
            if knife.region is not None:
                taken = [s for t in taken for s in _solids(t & solid_of(knife.region[1]))]
            halves = taken + rest
        if halves:
            parts = [p for p in parts if p is not nearest] + halves
    return parts


def _lie_apart(some: Sequence[Any], others: Sequence[Any], plane: Plane) -> bool:
    """Return whether two groups of solids lie on different sides of a plane."""
    sides = [
        {float((centroid(s.wrapped) - plane.origin) @ plane.normal) > 0 for s in group}
        for group in (some, others)
    ]
    return not sides[0] & sides[1]


def _nearest(solids: Sequence[Any], at: Float) -> Any:
    return min(solids, key=lambda p: float(np.linalg.norm(centroid(p.wrapped) - at)))


def _solids(result: Any) -> list[Any]:
    """Return the solids in the result of a boolean operation: a shape, a list of them, or nothing;
    without the empty ones that it sometimes leaves.
    """
    if result is None:
        return []
    shapes = result if isinstance(result, list | tuple | bd.ShapeList) else [result]
    return [s for r in shapes for s in r.solids() if s.volume > MIN_VOLUME_MM3]


def centroid(solid: Any) -> Float:
    """Return the center of mass (3,) of a TopoDS_Solid, mm."""
    c = bd.Solid(solid).center(bd.CenterOf.MASS)
    return np.array([c.X, c.Y, c.Z])


def as_one_solid(shape: Any) -> Any:
    """Return the one TopoDS_Solid of a build123d shape, healed if necessary.

    Boolean operations sometimes leave edges that miss their surface by more than their tolerance.

    Raises:
        FabricationError: If the shape is not one valid solid.
    """
    solids = list(shape.solids())
    if len(solids) != 1 or solids[0].volume <= 0:
        raise FabricationError(
            f"the geometry kernel made {len(solids)} solids of one part"
            if len(solids) != 1
            else "the geometry kernel lost the volume of a part",
            code="not-one-solid",
            count=len(solids),
        )
    solid = solids[0]
    if not solid.is_valid:
        healed = solid.fix()
        if not healed.is_valid or abs(healed.volume / solid.volume - 1) > MAX_HEALING_CHANGE:
            raise FabricationError(
                "the geometry kernel made a part that is not a valid solid",
                code="solid-invalid",
            )
        solid = healed
    return solid.wrapped
