"""Find the faces in which a part meets others, and the hollows that open into each of them.

The hollows of a face are the cores of its lid.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import manifold3d as m3
import numpy as np

from ...core.arrays import Float, format_point
from ...core.errors import FabricationError
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import axes_from_normal
from ..kernels.triangle_kernel import from_plane_frame, to_plane_frame
from ..parts.part_contacts import Contact
from ..parts.records import PartSet
from .records import Face

MAX_RISE_MM = 0.02  # by which a part may rise over the plane of one of its faces
TOUCH_MM = 1e-3  # from a face
MIN_NOTCH_WIDTH_MM = 0.3  # narrower notches are ignored
MAX_CRUMB_MM3 = 0.3  # of a hollow that reaches no face: rounding of facets
SECTION_OFFSET_MM = 1e-3  # from a face, where its section is taken
MAX_SLIVER_MM3 = 1e-3
LIFT_DISTANCES_MM = (0.2, 0.6, 1.5, 4.0)  # of a core that is taken out


def find_faces(part_set: PartSet, index: int) -> list[Face]:
    """Return the faces of a part, the largest first.

    Args:
        part_set: The parts.
        index: Index of the part.

    Raises:
        FabricationError: If the part has no face, or a hollow that opens into none.
    """
    part, bare = part_set.parts[index], part_set.bare[index]
    face_of_cut: dict[int, tuple[Float, Float, float]] = {}
    contacts_of_cut: dict[int, list[Contact]] = {}
    for contact in part_set.contacts:
        if index in (contact.lower, contact.upper):
            outward = contact.plane.normal if contact.lower == index else -contact.plane.normal
            area = face_of_cut[contact.cut][2] if contact.cut in face_of_cut else 0.0
            contacts_of_cut.setdefault(contact.cut, []).append(contact)
            face_of_cut[contact.cut] = (outward, contact.plane.origin, area + contact.area)
    if not face_of_cut:
        raise FabricationError(
            "cannot be cast: it has no face in which it meets another part, where the mould"
            " could open",
            code="no-joint-face",
            where=part.name,
            action="Choose a process that prints",
            part=part.name,
        )
    ordered = sorted(face_of_cut.values(), key=lambda f: -f[2])
    hollows = unite_hollows(part_set, index)
    cores: list[list[Any]] = [[] for _ in ordered]
    for hollow in (bare ^ hollows).decompose() if hollows is not None else []:
        corners = triangle_kernel.to_surface(hollow).vertices
        faces_met = [
            k for k, (n, o, _) in enumerate(ordered) if ((corners - o) @ n).max() > -TOUCH_MM
        ]
        if faces_met:
            cores[max(faces_met, key=lambda k: _opening_area(hollow, *ordered[k][:2]))].append(
                hollow
            )
        elif hollow.volume() > MAX_CRUMB_MM3:
            at = format_point(triangle_kernel.to_surface(hollow).centroid)
            raise FabricationError(
                f"cannot be cast: a hole near {at} opens into none of its faces, so that"
                f" nothing in the mould could leave it",
                code="hollow-not-castable",
                where=part.name,
                action="Set strain_relief = false or remove [body.bay], or choose a process"
                " that prints",
                part=part.name,
            )
    cuts = sorted(face_of_cut, key=lambda cut: -face_of_cut[cut][2])
    return [
        _make_face(bare, *ordered[k], cores[k], contacts_of_cut[cut]) for k, cut in enumerate(cuts)
    ]


def _make_face(
    bare: Any,
    normal: Float,
    origin: Float,
    area: float,
    core: Sequence[Any],
    contacts: Sequence[Contact],
) -> Face:
    """Return a face; its core includes the notch in which the face lies, if there is one."""
    rise = (triangle_kernel.to_surface(bare).vertices - origin) @ normal
    if rise.max() <= MAX_RISE_MM:
        return Face(normal, origin, area, triangle_kernel.union(core) if core else None)
    axes = axes_from_normal(normal)
    local = to_plane_frame(bare, axes, origin)
    floor = local.slice(-MAX_RISE_MM) - local.slice(MAX_RISE_MM)
    floor = floor.offset(-MIN_NOTCH_WIDTH_MM).offset(MIN_NOTCH_WIDTH_MM)
    contact_area = triangle_kernel.union(
        [
            to_plane_frame(
                from_plane_frame(m3.Manifold.extrude(c.section, 1.0), c.plane.axes, c.plane.origin),
                axes,
                origin,
            )
            for c in contacts
        ]
    ).project()
    notches = [p for p in floor.decompose() if (p ^ contact_area).area() > MIN_NOTCH_WIDTH_MM]
    if not notches:
        return Face(normal, origin, area, triangle_kernel.union(core) if core else None)
    high = float(rise.max())
    notch = triangle_kernel.union(
        [m3.Manifold.extrude(p, high + TOUCH_MM).translate([0, 0, -TOUCH_MM]) for p in notches]
    )
    notch = from_plane_frame(notch, axes, origin)
    core_with_notch = triangle_kernel.union([*core, notch - bare])
    return Face(normal, origin + high * normal, area, core_with_notch, notch)


def _opening_area(hollow: Any, normal: Float, origin: Float) -> float:
    """Return the area with which a hollow opens into a face, mm^2."""
    return float(
        to_plane_frame(hollow, axes_from_normal(normal), origin).slice(-2 * TOUCH_MM).area()
    )


def fill_notches(bare: Any, sides: Sequence[Face]) -> Any:
    """Return the part without hollows, with the notches over its faces filled."""
    notches = [f.notch for f in sides if f.notch is not None]
    return triangle_kernel.union([bare, *notches]) if notches else bare


def unite_hollows(part_set: PartSet, index: int) -> Any:
    """Return all tools that cut into the part with this index as one solid, or None."""
    tools = [c.solid for c in part_set.channels]
    tools += [triangle_kernel.solid_of(t) for t in part_set.tools(index)]
    return triangle_kernel.union(tools) if tools else None


def mouth_directions(part_set: PartSet) -> Float:
    """Return the directions (n, 3) in which channels and wires leave the body."""
    out = []
    for channel in part_set.channels:
        for line in channel.lines:
            out += [line[0] - line[1], line[-1] - line[-2]]
    directions = np.array(out).reshape(-1, 3)
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))


def bridge_face(solid: Any, normal: Float, origin: Float, above: float) -> Any:
    """Return a thin prism on a solid's section just below a face, up to `above` mm over it.

    Two solids that would only meet in the face overlap with it, so that no film stays between them.
    """
    axes = axes_from_normal(normal)
    section = to_plane_frame(solid, axes, origin).slice(-SECTION_OFFSET_MM)
    prism = m3.Manifold.extrude(section, above + 2 * SECTION_OFFSET_MM).translate(
        [0, 0, -2 * SECTION_OFFSET_MM]
    )
    return from_plane_frame(prism, axes, origin)


def find_core_cover(shell: Any, face: Face) -> Any:
    """Return the part of a mould's shell that blocks a face's core as it is taken out, or None.

    The part includes a little more around it.
    """
    axes = axes_from_normal(face.normal)
    core, around = (
        to_plane_frame(face.core, axes, face.origin),
        to_plane_frame(shell, axes, face.origin),
    )
    covers = []
    for distance in LIFT_DISTANCES_MM:
        for overlap in (core.translate([0, 0, distance]) ^ around).decompose():
            if overlap.volume() > MAX_SLIVER_MM3:
                x0, y0, _, x1, y1, _ = overlap.bounding_box()
                box = m3.Manifold.cube([x1 - x0 + 1, y1 - y0 + 1, 200]).translate(
                    [x0 - 0.5, y0 - 0.5, -200]
                )
                nearby_core = core ^ box
                low = nearby_core.bounding_box()[2]
                covers.append(
                    m3.Manifold.extrude(nearby_core.project(), -low).translate([0, 0, low])
                )
    if not covers:
        return None
    cover = triangle_kernel.union(covers) ^ around
    return from_plane_frame(cover, axes, face.origin) if cover.volume() > MAX_SLIVER_MM3 else None


def widen(solid: Any, normal: Float, by: float) -> Any:
    """Return the union of a solid and copies moved `by` mm all around, across `normal`."""
    axes = axes_from_normal(normal)
    turns = np.arange(8) * np.pi / 4
    offsets = by * np.stack([np.cos(turns), np.sin(turns)], axis=1) @ axes[:, :2].T
    return triangle_kernel.union([solid, *(solid.translate(w.tolist()) for w in offsets)])
