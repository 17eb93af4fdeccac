"""The figure of cords that are stretched twice."""

from __future__ import annotations

from collections.abc import Mapping

from ....report.html import as_image
from .stretched_cord import Stretched

_COLORS = ("#1f5fa8", "#e08a1e")


def stretch_figure(drawn: Mapping[str, Stretched]) -> str:
    """As Fig. 10: the relative change of resistance over time of each kind of cord, both times, and
    the pattern below; PNG as a data URI."""
    from matplotlib.figure import Figure

    figure = Figure((9.0, 2.2 * len(drawn) + 1.6), dpi=110, layout="constrained")
    axes = figure.subplots(len(drawn) + 1, 1, sharex=True)
    for ax, (name, run) in zip(axes, drawn.items(), strict=False):
        for answer, color, label in zip(run.answers, _COLORS, ("first time", "second time"),
                                        strict=False):  # fmt: skip
            ax.plot(run.time, answer, color=color, lw=1.2, label=label)
        ax.set_ylabel("(R - R0)/R0")
        ax.set_title(name, loc="left", fontsize=10)
    axes[0].legend(fontsize=8, frameon=False, ncols=2, loc="upper left")
    run = next(iter(drawn.values()))
    axes[-1].plot(run.time, 100 * run.strain, color="#111111", lw=1.2)
    axes[-1].set_ylabel("strain, %")
    axes[-1].set_xlabel("time, s")
    return as_image(figure)
