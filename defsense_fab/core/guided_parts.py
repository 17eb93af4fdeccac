"""Parts of a guided run's view: pictures, bars, plots and tables, independent of the screen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .arrays import Bool, Float

_BAR_MARGIN = 1.15  # full length of a resistance's bar, relative to the largest resistance


@dataclass(frozen=True)
class Picture:
    """Image of a camera.

    Attributes:
        name: Name of the camera.
        caption: What the camera sees.
        image: Gray (h, w) or BGR (h, w, 3); None without a recent one.
        outlines: Closed outlines (k, n, 2), or points (k, 1, 2), px.
        labels: Texts in the middle of the outlines (k,); empty for none.
        highlighted: Which outlines are highlighted (k,).
    """

    name: str
    caption: str
    image: NDArray[np.uint8] | None
    outlines: Float
    labels: tuple[str, ...]
    highlighted: Bool


@dataclass(frozen=True)
class Bars:
    """Rows of one or several bars each, which are filled more or less.

    Attributes:
        values: Filled share of each bar (r, c), 0 to 1.
        names: Names of the rows (r,); empty for none.
        texts: Texts after the rows (r,); empty for none.
        title: What is shown; empty for none.
        has_colors: Whether each row has the color of the curve with its number.
        bands: Expected range of each row (r, 2), as filled shares; None for none.
        states: State of each row (r,), "ok", "fault" or "" if unknown, which colors it; empty for
            none.
    """

    values: Float
    names: tuple[str, ...] = ()
    texts: tuple[str, ...] = ()
    title: str = ""
    has_colors: bool = False
    bands: Float | None = None
    states: tuple[str, ...] = ()


@dataclass(frozen=True)
class Curve:
    """Points or a line of a plot.

    Attributes:
        name: Name in the legend; empty for none.
        x: Coordinates (n,).
        y: Coordinates (n,); NaN where there is no point.
        color: Number of the color, None for gray.
        is_line: Whether the points are connected.
    """

    name: str
    x: Float
    y: Float
    color: int | None = None
    is_line: bool = False


@dataclass(frozen=True)
class Plot:
    """Plot of curves.

    Attributes:
        title: What is shown, with the limits of the axes; empty for none.
        curves: The curves, the last one on top.
        x: Limits of x, left and right.
        y: Limits of y, bottom and top.
        aspect: Height relative to the width.
        has_axes: Whether the lines x = 0 and y = 0 are drawn.
    """

    title: str
    curves: tuple[Curve, ...]
    x: tuple[float, float]
    y: tuple[float, float]
    aspect: float
    has_axes: bool = True


Part = Picture | Bars | Plot


def draw_picture(
    part: Picture,
    size: tuple[int, int],
    highlight: tuple[int, int, int],
    mark: tuple[int, int, int],
    line_width: int = 1,
) -> NDArray[np.uint8]:
    """Return the image of a camera with its outlines, RGB (h, w, 3).

    Args:
        part: Picture with an image.
        size: Width and height of the result, pixels.
        highlight: Color (r, g, b) of highlighted outlines.
        mark: Color (r, g, b) of the other ones.
        line_width: Width of the outlines, pixels.
    """
    import cv2

    assert part.image is not None
    h, w = part.image.shape[:2]
    out = cv2.resize(part.image, size, interpolation=cv2.INTER_AREA)
    out = cv2.cvtColor(out, cv2.COLOR_GRAY2RGB if out.ndim == 2 else cv2.COLOR_BGR2RGB)
    scale = np.array([size[0] / w, size[1] / h])
    for outline, is_highlighted in zip(part.outlines, part.highlighted, strict=True):
        corners = np.round((outline + 0.5) * scale - 0.5).astype(np.int32)
        cv2.polylines(out, [corners], True, highlight if is_highlighted else mark, line_width)
    return np.asarray(out, np.uint8)


def resistance_bars(ohm: Mapping[str, float]) -> Bars:
    """Return a bar for each resistance.

    Args:
        ohm: Resistances by name, ohm; 0 is a short circuit, infinity an open one, NaN unknown.
    """
    full = _BAR_MARGIN * max((r for r in ohm.values() if math.isfinite(r)), default=1.0) or 1.0
    values, texts = [], []
    for r in ohm.values():
        values.append([max(r / full, 0.0) if math.isfinite(r) else 0.0])
        unusual = "-" if math.isnan(r) else "short" if r == 0 else "open"
        texts.append(f"{r:.1f} ohm" if math.isfinite(r) and r != 0 else unusual)
    return Bars(np.array(values), tuple(ohm), tuple(texts), has_colors=True)
