"""The faces of a part in which it meets others, and what each of them has hollowed out."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.arrays import Float, xyz
from ...core.errors import FabricationError
from ..kernels import triangle_kernel
from ..parts.records import Made
from .planar import flat
from .records import Face

_ABOVE = 0.02  # mm, by which a part may stand over the plane of one of its faces
_TOUCHES = 1e-3  # mm, from a face
_CRUMB = 0.3  # mm^3, of a hollow that reaches no face: rounding of facets


def faces(made: Made, index: int) -> list[Face]:
    """Of the part with this index, the largest first.

    Raises FabricationError for a part that wraps round one of its faces, or has a hollow that opens
    into none.
    """
    part, bare = made.parts[index], made.bare[index]
    found: dict[int, tuple[Float, Float, float]] = {}
    for contact in made.contacts:
        if index in (contact.lower, contact.upper):
            out = contact.plane.normal if contact.lower == index else -contact.plane.normal
            area = found[contact.cut][2] if contact.cut in found else 0.0
            found[contact.cut] = (out, contact.plane.origin, area + contact.area)
    vertices = triangle_kernel.to_surface(bare).vertices
    for normal, origin, _ in found.values():
        over = (vertices - origin) @ normal
        if over.max() > _ABOVE:
            raise FabricationError(
                f"{part.name} cannot be cast: it wraps round the end of a cut near"
                f" {xyz(vertices[int(over.argmax())])}, and no mould opens there; set limit_cuts ="
                " false in [fabrication], move that cord's plane, or choose a process that prints"
            )
    if not found:
        raise FabricationError(
            f"{part.name} cannot be cast: it has no face in which it meets another part, for the"
            " mould to open at; choose a process that prints"
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
            at = xyz(triangle_kernel.centroid(triangle_kernel.to_surface(hollow)))
            raise FabricationError(
                f"{part.name} cannot be cast: a hole near {at} opens into none of its faces, and"
                " nothing in the mould could leave it; set strain_relief = false or remove"
                " [body.bay], or choose a process that prints"
            )
    return [
        Face(n, o, area, triangle_kernel.union(own) if own else None)
        for (n, o, area), own in zip(ordered, cores, strict=True)
    ]


def _opening(hollow: Any, normal: Float, origin: Float) -> float:
    """Area, mm^2, with which a hollow opens into a face."""
    from ..kernels.cutting_tools import frame

    return float(flat(hollow, frame(normal), origin).slice(-2 * _TOUCHES).area())


def hollows_of(made: Made, index: int) -> Any:
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


def mouths(made: Made) -> Float:
    """Directions (n, 3) in which channels and wires leave the body."""
    out = []
    for channel in made.channels:
        for line in channel.lines:
            out += [line[0] - line[1], line[-1] - line[-2]]
    ways = np.array(out).reshape(-1, 3)
    return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True))
