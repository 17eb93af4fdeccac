"""Find the faces in which a part meets others, and the hollows that open into each of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import manifold3d as m3
import numpy as np

from ...core.arrays import Float, format_point
from ...core.errors import FabricationError
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import axes_from_normal
from ..parts.part_contacts import Contact
from ..parts.records import PartSet
from .planar import from_plane_frame, to_plane_frame
from .records import Face

MAX_RISE_MM = 0.02  # by which a part may rise over the plane of one of its faces
TOUCH_MM = 1e-3  # from a face
MIN_NOTCH_WIDTH_MM = 0.3  # narrower notches are ignored
MAX_CRUMB_MM3 = 0.3  # of a hollow that reaches no face: rounding of facets


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
            at = format_point(triangle_kernel.centroid(triangle_kernel.to_surface(hollow)))
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
    notch = m3.Manifold.batch_boolean(
        [m3.Manifold.extrude(p, high + TOUCH_MM).translate([0, 0, -TOUCH_MM]) for p in notches],
        m3.OpType.Add,
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
    for pin in part_set.pins:
        contact = part_set.contacts[pin.contact]
        for other, upper in ((contact.lower, False), (contact.upper, True)):
            if other == index:
                tools.append(triangle_kernel.solid_of(pin.socket_in(upper=upper)))
    for label in part_set.labels:
        if label.part == index:
            tools += [triangle_kernel.solid_of(t) for t in label.tools]
    return triangle_kernel.union(tools) if tools else None


def mouth_directions(part_set: PartSet) -> Float:
    """Return the directions (n, 3) in which channels and wires leave the body."""
    out = []
    for channel in part_set.channels:
        for line in channel.lines:
            out += [line[0] - line[1], line[-1] - line[-2]]
    directions = np.array(out).reshape(-1, 3)
    return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))
