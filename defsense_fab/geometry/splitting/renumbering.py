"""The records of parts where one of them has become two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...core.arrays import Float
from ..parts.alignment_pins import Pin
from ..parts.division import Cut
from ..parts.part_contacts import Contact
from ..parts.records import Made, Part

_FAR = 1e4  # mm, beyond all of a body


def renumbered(
    made: Made,
    index: int,
    normal: Float,
    height: float,
    contact: Contact,
    dowels: Sequence[Pin],
    parts: Sequence[Part],
    bares: Sequence[Any],
    removed: float,
) -> Made:
    """All that names parts by their index, with the part at `index` in two: `parts` and, without
    channels and sockets, `bares` below and above the plane at `height` mm along `normal`; they
    meet in `contact`, with `dowels`, and `removed` mm^3 were cut out of them."""

    def moved(i: int) -> int:
        return i + 1 if i > index else i

    def side(group: tuple[int, ...]) -> tuple[int, ...]:
        out = [moved(i) for i in group]
        return tuple(sorted([*out, index + 1] if index in group else out))

    old: list[Contact] = []
    where: dict[tuple[int, bool], int] = {}
    for k, c in enumerate(made.contacts):
        if index not in (c.lower, c.upper):
            where[k, False] = where[k, True] = len(old)
            old.append(replace(c, lower=moved(c.lower), upper=moved(c.upper)))
            continue
        for above in (False, True):
            own = index + int(above)
            where[k, above] = len(old)
            old.append(
                replace(
                    c,
                    lower=own if c.lower == index else moved(c.lower),
                    upper=own if c.upper == index else moved(c.upper),
                    section=_clipped(c, normal if above else -normal, height if above else -height),
                )
            )

    def owner(k: int, at: Float) -> int:
        return where[k, bool(at @ normal > height)]

    pins = [replace(p, contact=owner(p.contact, p.center)) for p in made.pins]
    labels = [
        replace(
            label,
            part=index + int(bool(label.center @ normal > height))
            if label.part == index
            else moved(label.part),
            contact=owner(label.contact, label.center),
        )
        for label in made.labels
    ]
    cuts = [replace(c, sides=(side(c.sides[0]), side(c.sides[1]))) for c in made.cuts]
    cuts.append(Cut(contact.plane, contact.plane.origin, (), ((index,), (index + 1,))))
    new = replace(contact, lower=index, upper=index + 1)
    return replace(
        made,
        parts=(*made.parts[:index], *parts, *made.parts[index + 1 :]),
        bare=(*made.bare[:index], *bares, *made.bare[index + 1 :]),
        cuts=tuple(cuts),
        contacts=(*old, new),
        pins=(*pins, *(replace(d, contact=len(old)) for d in dowels)),
        labels=tuple(labels),
        cut_out=made.cut_out + removed,
    )


def _clipped(contact: Contact, normal: Float, height: float) -> Any:
    """What of a contact's face lies where `normal` looks, beyond the height."""
    import manifold3d as m3

    plane = contact.plane
    way = plane.axes[:, :2].T @ normal
    size = float(np.linalg.norm(way))
    if size < 1e-6:
        beyond = float(plane.origin @ normal) >= height
        return contact.section if beyond else m3.CrossSection()
    away = (height - float(plane.origin @ normal)) / size
    x = way / size
    y = np.array([-x[1], x[0]])
    corners = [away * x - _FAR * y, (away + _FAR) * x - _FAR * y]
    corners += [(away + _FAR) * x + _FAR * y, away * x + _FAR * y]
    return contact.section ^ m3.CrossSection([np.array(corners)])


def lettered(made: Made, index: int, count: int, name: str) -> Made:
    """Pieces by letters, in the order in which they follow one another."""
    parts = list(made.parts)
    for k in range(count):
        parts[index + k] = replace(parts[index + k], name=f"{name}-{chr(97 + k)}")
    return replace(made, parts=tuple(parts))
