"""Edits of the shapes of regions."""

from __future__ import annotations

from typing import Any

from tomlkit import TOMLDocument

from ...core.device.regions import Box, HalfSpace, Shape, Sphere
from .edit import Edit, inline, number, numbers
from .poses import check_region


def set_shape(region: str, shape: Shape, *, is_new: bool = False) -> Edit:
    """Set the shape of a region, or add it.

    Args:
        region: Name of the region.
        shape: Its shape.
        is_new: Whether it is added; otherwise it must exist.
    """

    def change(document: TOMLDocument) -> None:
        if not is_new:
            check_region(document, region)
        regions: Any = document.setdefault("regions", inline({}))
        regions[region] = shape_table(shape)

    return Edit(f"{'add' if is_new else 'set'} the region `{region}`", change)


def shape_table(shape: Shape) -> Any:
    """Return the inline table of a shape."""
    if isinstance(shape, Box):
        return inline({"box": numbers([shape.low, shape.high])})
    if isinstance(shape, Sphere):
        values = {"center": numbers(shape.center), "radius": number(shape.radius)}
        return inline({"sphere": inline(values)})
    if isinstance(shape, HalfSpace):
        values = {"origin": numbers(shape.origin), "normal": numbers(shape.normal)}
        return inline({"half_space": inline(values)})
    values = {
        "start": numbers(shape.start),
        "end": numbers(shape.end),
        "radius": number(shape.radius),
    }
    return inline({"cylinder": inline(values)})
