"""Turn a stroke drawn on a plane through the body into the path of a cord."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...core.curve import Hermite, Plane, arc_lengths, resample
from ...core.curve_conversion import fit_curve
from ...core.errors import LayoutError
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import inside_section, plane_section

STROKE_TOLERANCE_MM = 0.5  # of the path from the stroke; hands and screens are no better
_STEP_MM = 0.5  # between points of a stroke
_MAX_EXTENSION_MM = 20.0  # by which ends near the skin are extended to it
_END_DEPTH_MM = 1.0  # of a path's end below the skin; its channel continues straight from there
_AIM_LENGTH_MM = 8.0  # of a stroke's end, which gives its direction


def fit_stroke(surface: Surface, plane: Plane, stroke: Float) -> Hermite:
    """Fit a path to the longest part of a stroke inside the body.

    Ends near the skin are extended to just below it.

    Args:
        surface: The body's surface.
        plane: The plane of the stroke.
        stroke: Points (q, 2) mm in the plane.

    Raises:
        LayoutError: If the plane misses the body, or the stroke is too short or lies outside.
    """
    section = plane_section(surface, plane)
    if not len(section):
        raise LayoutError(
            "the plane misses the body", code="plane-misses-body", action="Move it until it cuts it"
        )
    stroke = np.asarray(stroke, float).reshape(-1, 2)
    stroke = stroke[np.isfinite(stroke).all(axis=1)]
    lengths = arc_lengths(stroke) if len(stroke) > 1 else np.zeros(1)
    if lengths[-1] < _STEP_MM:
        raise LayoutError(
            "the stroke is too short", code="stroke-too-short", action="Draw along the whole cord"
        )
    points = resample(stroke, 0.0, float(lengths[-1]), int(lengths[-1] / _STEP_MM) + 2)
    inside = _longest_run(inside_section(section, points))
    if inside.stop - inside.start < 2:
        raise LayoutError(
            "the stroke lies outside of the body's section",
            code="stroke-outside-body",
            action="Draw across the section",
        )
    line = points[inside]
    start = _extend_to_skin(section, line[::-1])
    end = _extend_to_skin(section, line)
    line = np.concatenate([start[::-1], line, end])
    length = float(arc_lengths(line)[-1])
    if length < 2 * _END_DEPTH_MM + _STEP_MM:
        raise LayoutError(
            "the stroke is too short within the body",
            code="stroke-too-short",
            action="Draw along the whole cord",
        )
    trims = [_END_DEPTH_MM if len(extension) else 0.0 for extension in (start, end)]
    return fit_curve(
        resample(line, trims[0], length - trims[1], int(length / _STEP_MM) + 2), STROKE_TOLERANCE_MM
    )


def _longest_run(inside: np.ndarray) -> slice:
    """Return the longest run of points that are inside."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
    if not len(edges):
        return slice(0, 0)
    starts, stops = edges[::2], edges[1::2]
    k = int((stops - starts).argmax())
    return slice(int(starts[k]), int(stops[k]))


def _extend_to_skin(section: Float, line: Float) -> Float:
    """Return points (k, 2) that extend a line (q, 2) straight to the skin, or none if it is far."""
    aim = int(min(_AIM_LENGTH_MM / _STEP_MM, len(line) - 1))
    chord = line[-1] - line[-1 - aim]
    along = chord / np.linalg.norm(chord)
    across = np.array([-along[1], along[0]])
    a, b = ((section[:, k] - line[-1]) @ across for k in (0, 1))
    crossed = (a > 0) != (b > 0)
    share = (a / np.where(crossed, a - b, 1.0))[crossed, None]
    crossings = section[crossed, 0] + share * (section[crossed, 1] - section[crossed, 0])
    ahead = (crossings - line[-1]) @ along
    ahead = ahead[ahead >= 0]
    if not len(ahead) or ahead.min() > _MAX_EXTENSION_MM:
        return line[:0]
    distance = float(ahead.min())
    return np.asarray(
        line[-1] + np.linspace(0, distance, int(distance / _STEP_MM) + 2)[1:, None] * along
    )
