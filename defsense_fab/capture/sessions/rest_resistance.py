"""The resistances at rest, R0, that the signals of a session's runs refer to.

Cords drift, by per cents in hours: each run has its own R0, from its own rests.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Bool, Float


def rest_resistances(
    names: Sequence[str], channels: Sequence[str], ohm: Sequence[Float], rest: Sequence[Bool]
) -> tuple[Float, list[str]]:
    """R0 (r, c) ohm of runs by their `names`, and warnings. `ohm`: resistances (t, c) of each run,
    NaN where not known, of which `rest` (t,) were measured at rest.

    R0 is the median at rest. Of a cord without a number there it is that of the nearest run that
    has one (of two, the earlier); where no run has any, its median over the whole session.
    """
    own = np.array([_medians(R[at]) for R, at in zip(ohm, rest, strict=True)])
    never = ~np.isfinite(own).any(axis=0)
    out, borrowed = own.copy(), dict[tuple[int, int], list[str]]()
    out[:, never] = _medians(np.concatenate(ohm))[never]
    warnings = [
        f"no rest was measured of {channel} in any run; its R0 is the median of the session"
        for channel, none in zip(channels, never, strict=True)
        if none and not never.all()
    ]
    for k, R in enumerate(ohm):
        for c, channel in enumerate(channels):
            others = np.flatnonzero(np.isfinite(own[:, c]))
            if np.isfinite(own[k, c]) or not len(others) or not np.isfinite(R[:, c]).any():
                continue
            lender = int(others[np.abs(others - k).argmin()])
            out[k, c] = own[lender, c]
            borrowed.setdefault((k, lender), []).append(channel)
    return out, warnings + [
        f"{names[k]}: no rest was measured of {', '.join(of)}; R0 is that of {names[lender]}, from"
        " which the cords may have drifted"
        for (k, lender), of in borrowed.items()
    ]


def _medians(values: Float) -> Float:
    """Of columns (n, c), NaN for those without a number."""
    finite = [v[np.isfinite(v)] for v in values.T]
    return np.array([float(np.median(v)) if len(v) else np.nan for v in finite])
