"""The faces of a part in which it meets others, and what each of them has hollowed out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import manifold3d as m3
import numpy as np

from ...core.arrays import Float, format_point
from ...core.errors import FabricationError
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import frame
from ..parts.part_contacts import Contact
from ..parts.records import PartSet
from .planar import flat, upright
from .records import Face

_ABOVE = 0.02  # mm, by which a part may stand over the plane of one of its faces
_TOUCHES = 1e-3  # mm, from a face
_WIDE = 0.3  # mm, of a notch that is one
_CRUMB = 0.3  # mm^3, of a hollow that reaches no face: rounding of facets


def faces(made: PartSet, index: int) -> list[Face]:
    """Of the part with this index, the largest first.

    Raises FabricationError for a part without faces, or with a hollow that opens into none.
    """
    part, bare = made.parts[index], made.bare[index]
    found: dict[int, tuple[Float, Float, float]] = {}
    meeting: dict[int, list[Contact]] = {}
    for contact in made.contacts:
        if index in (contact.lower, contact.upper):
            out = contact.plane.normal if contact.lower == index else -contact.plane.normal
            area = found[contact.cut][2] if contact.cut in found else 0.0
            meeting.setdefault(contact.cut, []).append(contact)
            found[contact.cut] = (out, contact.plane.origin, area + contact.area)
    if not found:
        raise FabricationError(
            f"{part.name} cannot be cast: it has no face in which it meets another part, for the"
            " mould to open at; choose a process that prints",
            code="no-joint-face",
            part=part.name,
        )
    ordered = sorted(found.values(), key=lambda f: -f[2])
    hollows = hollows_of(made, index)
    cores: list[list[Any]] = [[] for _ in ordered]
    for hollow in (bare ^ hollows).decompose() if hollows is not None else []:
        corners = triangle_kernel.to_surface(hollow).vertices
        meets = [k for k, (n, o, _) in enumerate(ordered) if ((corners - o) @ n).max() > -_TOUCHES]
        if meets:
            cores[max(meets, key=lambda k: _opening(hollow, *ordered[k][:2]))].append(hollow)
        elif hollow.volume() > _CRUMB:
            at = format_point(triangle_kernel.centroid(triangle_kernel.to_surface(hollow)))
            raise FabricationError(
                f"{part.name} cannot be cast: a hole near {at} opens into none of its faces, and"
                " nothing in the mould could leave it; set strain_relief = false or remove"
                " [body.bay], or choose a process that prints",
                code="hollow-not-castable",
                part=part.name,
            )
    which = sorted(found, key=lambda cut: -found[cut][2])
    return [_face(bare, *ordered[k], cores[k], meeting[cut]) for k, cut in enumerate(which)]


def _face(
    bare: Any,
    normal: Float,
    origin: Float,
    area: float,
    core: Sequence[Any],
    meeting: Sequence[Contact],
) -> Face:
    """The face, its core united with the notch in which the face lies, where there is one."""
    over = (triangle_kernel.to_surface(bare).vertices - origin) @ normal
    if over.max() <= _ABOVE:
        return Face(normal, origin, area, triangle_kernel.union(core) if core else None)
    axes = frame(normal)
    local = flat(bare, axes, origin)
    floor = local.slice(-_ABOVE) - local.slice(_ABOVE)
    floor = floor.offset(-_WIDE).offset(_WIDE)
    met = triangle_kernel.union(
        [
            flat(upright(m3.Manifold.extrude(c.section, 1.0), c.plane.axes, c.plane.origin), axes,
                 origin)
            for c in meeting
        ]
    ).project()  # fmt: skip
    own = [p for p in floor.decompose() if (p ^ met).area() > _WIDE]
    if not own:
        return Face(normal, origin, area, triangle_kernel.union(core) if core else None)
    high = float(over.max())
    notch = m3.Manifold.batch_boolean(
        [m3.Manifold.extrude(p, high + _TOUCHES).translate([0, 0, -_TOUCHES]) for p in own],
        m3.OpType.Add,
    )
    notch = upright(notch, axes, origin)
    filled = triangle_kernel.union([*core, notch - bare])
    return Face(normal, origin + high * normal, area, filled, notch)


def _opening(hollow: Any, normal: Float, origin: Float) -> float:
    """Area, mm^2, with which a hollow opens into a face."""
    return float(flat(hollow, frame(normal), origin).slice(-2 * _TOUCHES).area())


def filled(bare: Any, sides: Sequence[Face]) -> Any:
    """The part without hollows, notches over its faces filled."""
    notches = [f.notch for f in sides if f.notch is not None]
    return triangle_kernel.union([bare, *notches]) if notches else bare


def hollows_of(made: PartSet, index: int) -> Any:
    """All tools that cut into the part with this index, as one solid, or None."""
    tools = [c.solid for c in made.channels]
    for pin in made.pins:
        contact = made.contacts[pin.contact]
        for other, upper in ((contact.lower, False), (contact.upper, True)):
            if other == index:
                tools.append(triangle_kernel.solid_of(pin.socket_in(upper=upper)))
    for label in made.labels:
        if label.part == index:
            tools += [triangle_kernel.solid_of(t) for t in label.tools]
    return triangle_kernel.union(tools) if tools else None


def mouths(made: PartSet) -> Float:
    """Directions (n, 3) in which channels and wires leave the body."""
    out = []
    for channel in made.channels:
        for line in channel.lines:
            out += [line[0] - line[1], line[-1] - line[-2]]
    ways = np.array(out).reshape(-1, 3)
    return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True))
