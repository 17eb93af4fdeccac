"""The size of the tags as several cameras measure it, against the one that is stated.

Tags that were printed with "fit to page" are some per cent smaller. Places by several cameras do
not depend on the size; those by one camera are as many per cent too far away, or too near.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float

_WORTH = 0.01  # of the size, below which edges that look thinner or thicker explain it
_SURE = 2.0  # standard deviations
_FEW = 3  # places of a tag from which its size is taken
_MAD = 1.4826  # standard deviations of a normal distribution in a median absolute deviation
_MEDIAN = 1.2533  # by how much a median of many is less certain than their mean


@dataclass(frozen=True)
class MeasuredSize:
    """The median side of the tags, mm, its standard deviation `sigma`, mm, and `stated`, mm."""

    side: float
    sigma: float
    stated: float

    @property
    def warning(self) -> str | None:
        """What to say where the size that is stated is wrong."""
        off = abs(self.side - self.stated)
        if off <= max(_WORTH * self.stated, _SURE * self.sigma):
            return None
        part = self.side / self.stated
        return (
            f"the tags measure {self.side:.2f} mm where {self.stated:g} mm is stated (standard"
            f" deviation {self.sigma:.2g} mm): they seem to be printed at {part:.1%}, or the"
            " calibration's lengths are as wrong. Measure the black square of a tag: if it is"
            f" {self.side:.2f} mm, print tags at 100 % or state this size, since places that one"
            f" camera sees are {abs(1 / part - 1):.1%} too {'far' if part < 1 else 'near'}; if it"
            f" is {self.stated:g} mm, all places are wrong by as much: measure the squares of the"
            " calibration's board, and calibrate again"
        )


def measured_size(sides: Float, stated: float) -> MeasuredSize | None:
    """From the sides (t, m) mm of tags as located by several cameras, NaN where they were not; None
    where too few were. What tags have in common in one frame, and a tag in all frames, is not
    averaged out: the standard deviation is that by which tags and frames differ among each
    other."""
    columns = [s[np.isfinite(s)] for s in sides.T]
    columns = [s for s in columns if len(s) >= _FEW]
    if not columns:
        return None
    tags = np.array([np.median(s) for s in columns])
    within = np.array([_spread(s) for s in columns])
    # Where there are too few tags to tell by how much they differ, as much as frames do.
    between = _spread(tags) if len(tags) >= _FEW else float(np.median(within))
    frames = float(np.median(within / np.sqrt([len(s) for s in columns])))
    sigma = _MEDIAN * float(np.hypot(between / np.sqrt(len(tags)), frames))
    return MeasuredSize(float(np.median(tags)), sigma, float(stated))


def _spread(values: Float) -> float:
    """The standard deviation that the median absolute deviation tells."""
    return _MAD * float(np.median(np.abs(values - np.median(values))))
