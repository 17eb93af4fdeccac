"""What one camera saw of each tag over time, and at times between its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float, Int
from ..tags.tag_detection import TagView

_SAME = 5e-4  # s: frames this near in time are taken as simultaneous
_FAR = 2.5  # periods, between frames that are interpolated


@dataclass(frozen=True)
class Observations:
    """t frames of one camera, m tags: `time` (t,) s, increasing; numbers `ids` (m,); `corners`
    (t, m, 4, 2) px without distortion, NaN where not seen, and the `covariance` (t, m, 4, 2, 2)
    px^2 of each."""

    time: Float
    ids: Int
    corners: Float
    covariance: Float


def collect(time: Float, views: Sequence[TagView], ids: Int) -> Observations:
    """Views by tag. Of a number that is twice in an image, the one nearer to where the tag was last
    is taken; neither where it was not seen before."""
    place = {int(i): k for k, i in enumerate(ids)}
    corners = np.full((len(views), len(ids), 4, 2), np.nan)
    covariance = np.full((len(views), len(ids), 4, 2, 2), np.nan)
    last = np.full((len(ids), 2), np.nan)
    for t, view in enumerate(views):
        numbers = [int(i) for i in view.ids]
        for number in set(numbers) & place.keys():
            k = place[number]
            found = [n for n, i in enumerate(numbers) if i == number]
            if len(found) > 1:
                if np.isnan(last[k]).any():
                    continue
                away = np.linalg.norm(view.corners[found].mean(axis=1) - last[k], axis=1)
                found = [found[int(away.argmin())]]
            corners[t, k], covariance[t, k] = view.corners[found[0]], view.covariance[found[0]]
            last[k] = corners[t, k].mean(axis=0)
    return Observations(time, ids, corners, covariance)


def at(seen: Observations, time: Float) -> tuple[Float, Float]:
    """Corners (n, m, 4, 2) and covariances (n, m, 4, 2, 2) at other times (n,), s: along a cubic
    through four frames, or a line where they lack the tag; NaN where the frames beside do."""
    n, m = len(time), len(seen.ids)
    corners, covariance = np.full((n, m, 4, 2), np.nan), np.full((n, m, 4, 2, 2), np.nan)
    if not len(seen.time) or not n:
        return corners, covariance
    nearest = np.clip(np.searchsorted(seen.time, time), 1, max(len(seen.time) - 1, 1))
    before = nearest - 1
    if len(seen.time) > 1:
        closer = np.abs(seen.time[nearest] - time) < np.abs(seen.time[before] - time)
        nearest = np.where(closer, nearest, before)
    else:
        nearest = before
    same = np.abs(seen.time[nearest] - time) <= _SAME
    corners[same], covariance[same] = seen.corners[nearest[same]], seen.covariance[nearest[same]]
    if len(seen.time) < 2:
        return corners, covariance
    inside = ~same & (time > seen.time[0]) & (time < seen.time[-1])
    a = np.clip(np.searchsorted(seen.time, time[inside]) - 1, 0, len(seen.time) - 2)
    step = seen.time[a + 1] - seen.time[a]
    far = _FAR * float(np.median(np.diff(seen.time)))
    w = (time[inside] - seen.time[a]) / step
    w = np.where(step <= far, w, np.nan)[:, None, None, None]
    corners[inside] = (1 - w) * seen.corners[a] + w * seen.corners[a + 1]
    w = w[..., None]
    covariance[inside] = (1 - w) ** 2 * seen.covariance[a] + w**2 * seen.covariance[a + 1]
    _curve(seen, time, np.flatnonzero(inside), a, far, corners)
    return corners, covariance


def _curve(seen: Observations, time: Float, rows: Int, a: Int, far: float, corners: Float) -> None:
    """Put cubic polynomials through four frames in place of lines, where there are four: a hand's
    acceleration bends the way between two frames by some hundredths of a millimetre."""
    inner = np.flatnonzero((a >= 1) & (a + 2 < len(seen.time)))
    if not len(inner):
        return
    four = a[inner, None] + np.arange(-1, 3)
    at_ = seen.time[four]
    inner, four, at_ = (x[(np.diff(at_, axis=1) <= far).all(axis=1)] for x in (inner, four, at_))
    rows = rows[inner]
    out = np.zeros((len(rows), *corners.shape[1:]))
    for k in range(4):
        others = [n for n in range(4) if n != k]
        above = (time[rows, None] - at_[:, others]).prod(axis=1)
        weight = above / (at_[:, [k]] - at_[:, others]).prod(axis=1)
        out += weight[:, None, None, None] * seen.corners[four[:, k]]
    there = np.isfinite(out)
    corners[rows] = np.where(there, out, corners[rows])
