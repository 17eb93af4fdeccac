"""Texts and errors about bodies that are shared by repairs of meshes and of CAD solids."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....core.arrays import Float
from ....core.errors import BodyError

#: Largest coordinate, as a multiple of the largest size of a body. STL files hold coordinates in
#: single precision: at 15 m they are rounded by 0.001 mm, and farther away by more than there is
#: room for between parts.
MAX_REACH_SIZES = 1.5


def describe_point(p: Float) -> str:
    """Return a point (3,) mm as text, such as "(1, 2.5, 0)"."""
    return "(" + ", ".join(f"{x + 0.0:.4g}" for x in np.round(p, 6)) + ")"


def format_count(count: int, noun: str) -> str:
    """Return a count with its noun, such as "1 hole" or "2 holes"."""
    return f"{count} {noun}" + ("" if count == 1 else "s")


def describe_cavity(volume: float, middle: Float, smaller: int) -> str:
    """Describe a closed cavity.

    Args:
        volume: Its volume, mm^3.
        middle: Its center (3,), mm.
        smaller: Number of smaller cavities to mention.

    Returns:
        A noun phrase.
    """
    text = f"a closed cavity of {volume:.3g} mm3 around {describe_point(middle)}"
    return f"{text} and {smaller} smaller" if smaller else text


def describe_solids(solids: Sequence[tuple[float, Float]]) -> str:
    """Describe the first five of some solids, each by its volume, mm^3, and center (3,), mm."""
    text = "; ".join(f"{volume:.3g} mm3 around {describe_point(at)}" for volume, at in solids[:5])
    return f"{text} and {len(solids) - 5} more" if len(solids) > 5 else text


def closed_cavity_error(where: str, volume: float, middle: Float, smaller: int) -> BodyError:
    """Return the error for cavities that may not be filled; arguments as in `describe_cavity`."""
    return BodyError(
        f"{describe_cavity(volume, middle, smaller)} inside the body cannot be made: powder or"
        " resin stays in it, and no mould reaches it",
        code="closed-cavity",
        where=where,
        action="Write fill_cavities = true under [body] in device.toml to fill it, or open or"
        " remove"
        " it in the program that made the body",
        volume=volume,
        at=middle.tolist(),
        count=1 + smaller,
    )


def check_distance_from_origin(where: str, vertices: Float, largest_size: float) -> None:
    """Raise BodyError if vertices (n, 3) lie too far from the origin for STL files.

    Args:
        where: File to name in the error.
        vertices: Coordinates, mm.
        largest_size: Largest plausible size of a body, mm.
    """
    reach = float(np.abs(vertices).max())
    if reach > MAX_REACH_SIZES * largest_size:
        raise BodyError(
            f"the body reaches {reach / 1000:.3g} m away from the origin, where coordinates in STL"
            " files are rounded too much",
            code="far-from-origin",
            where=where,
            action="Move it to the origin",
            distance=reach,
        )
