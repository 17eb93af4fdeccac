"""What each part more or less costs in error."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.arrays import Float
from ...store.layout import WeighedRecord
from ..colors import COLORS
from ..html import as_image

_FEWEST = 2  # layouts, for a picture of their errors


def front(trials: Sequence[WeighedRecord]) -> str | None:
    """The layouts made on trial as points: error against parts; PNG as a data URI, or None where
    fewer than two could be made."""
    made = [t for t in trials if t.built is not None and t.parts is not None]
    if len(made) < _FEWEST:
        return None
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(6.5, 3.6), dpi=110, layout="constrained")
    axis = figure.subplots()
    for clear, label, face in ((True, "nothing to say of the parts", None), (False, "notes", "w")):
        some = [t for t in made if (not t.warnings) == clear]
        if some:
            x, y = _places(some)
            axis.scatter(x, y, s=60, edgecolor=COLORS[1], facecolor=face or COLORS[1], label=label)
    x, y = _places([t for t in made if t.chosen])
    axis.scatter(x, y, s=220, facecolor="none", edgecolor=COLORS[0], linewidth=2, label="taken")
    axis.set(xlabel="parts", ylabel="RMSE on unseen states, mm")
    axis.margins(x=0.15)
    axis.set_ylim(0, 1.15 * float(_places(made)[1].max()))
    axis.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axis.grid(True, alpha=0.25)
    axis.legend(fontsize="small")
    return as_image(figure)


def _places(trials: Sequence[WeighedRecord]) -> Float:
    """Parts and errors of trials (2, t)."""
    return np.array([(t.parts, t.built) for t in trials], float).reshape(-1, 2).T
