"""A cord from what a hand has drawn on a plane through the body."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ...core.curve import Hermite, Plane, arc_lengths, resample
from ...core.curve_conversion import fit_curve
from ...core.errors import LayoutError
from ...core.mesh import Surface
from ...geometry.kernels.surface_queries import inside_section, plane_section

#: A drawn line is followed this closely, mm; the hand and the screen are no better.
TOLERANCE = 0.5
_STEP = 0.5  # mm, between points of a stroke
_REACH = 20.0  # mm: ends that are this near to the skin go on to it
_BELOW = 1.0  # mm below the skin that a path ends; its channel runs on straight from there
_AIM = 8.0  # mm of a stroke's end, which tell where it goes


def drawn_curve(surface: Surface, plane: Plane, stroke: Float) -> Hermite:
    """A path along a `stroke` (q, 2) mm in a plane: its longest part within the body, whose ends go
    on to just below the skin where that is near. Raises LayoutError where the plane misses the
    body, and for a stroke that does not come into it."""
    section = plane_section(surface, plane)
    if not len(section):
        raise LayoutError("the plane misses the body; move it until it cuts it")
    stroke = np.asarray(stroke, float).reshape(-1, 2)
    stroke = stroke[np.isfinite(stroke).all(axis=1)]
    lengths = arc_lengths(stroke) if len(stroke) > 1 else np.zeros(1)
    if lengths[-1] < _STEP:
        raise LayoutError("the stroke is too short; draw along the whole cord")
    even = resample(stroke, 0.0, float(lengths[-1]), int(lengths[-1] / _STEP) + 2)
    inside = _longest(inside_section(section, even))
    if inside.stop - inside.start < 2:
        raise LayoutError("the stroke lies outside of the body's section; draw across it")
    line = even[inside]
    start = _on_to_skin(section, line[::-1])
    end = _on_to_skin(section, line)
    line = np.concatenate([start[::-1], line, end])
    length = float(arc_lengths(line)[-1])
    if length < 2 * _BELOW + _STEP:
        raise LayoutError("the stroke is too short within the body; draw along the whole cord")
    cut = [_BELOW if len(ran_on) else 0.0 for ran_on in (start, end)]
    return fit_curve(resample(line, cut[0], length - cut[1], int(length / _STEP) + 2), TOLERANCE)


def _longest(inside: np.ndarray) -> slice:
    """The longest run of points that are inside."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
    if not len(edges):
        return slice(0, 0)
    starts, stops = edges[::2], edges[1::2]
    k = int((stops - starts).argmax())
    return slice(int(starts[k]), int(stops[k]))


def _on_to_skin(section: Float, line: Float) -> Float:
    """What goes on behind the end of a `line` (q, 2) to the skin, (k, 2): straight as it came;
    nothing where the skin is too far that way."""
    back = int(min(_AIM / _STEP, len(line) - 1))
    way = line[-1] - line[-1 - back]
    along = way / np.linalg.norm(way)
    across = np.array([-along[1], along[0]])
    a, b = ((section[:, k] - line[-1]) @ across for k in (0, 1))
    crossed = (a > 0) != (b > 0)
    share = (a / np.where(crossed, a - b, 1.0))[crossed, None]
    places = section[crossed, 0] + share * (section[crossed, 1] - section[crossed, 0])
    ahead = (places - line[-1]) @ along
    ahead = ahead[ahead >= 0]
    if not len(ahead) or ahead.min() > _REACH:
        return line[:0]
    far = float(ahead.min())
    return np.asarray(line[-1] + np.linspace(0, far, int(far / _STEP) + 2)[1:, None] * along)
