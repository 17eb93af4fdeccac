"""The page about a response: the paper's Fig. 3 from the user's data, residuals, the neutral
cord."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..calibration.calibrate import Calibration
from ..sensing.response import Response, build_response
from .html import as_image, render

_COLORS = ("#d1495b", "#00798c", "#edae49", "#66a182", "#8d5a97", "#2e4057")


def page(found: Calibration, data: Mapping[str, Any]) -> str:
    """HTML, self-contained, of a calibration and what its `response.json` holds."""
    images = {"response": response_figure(found), "residuals": _residuals(found)}
    if len(found.neutral_changes):
        images["neutral"] = _neutral(found)
    return render("calibration", data=data, images=images, drift=found.drift)


def _figure(width: float = 9.0, height: float = 5.0) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure((width, height), dpi=110, layout="constrained")
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25)
    return figure, axes


def _band(found: Calibration, strain: Any) -> tuple[Any, Any, Any]:
    """w and its 95 % band in per cent: the slope's doubt, which grows with strain."""
    w = build_response(found.response)(strain)
    low, high = (end / found.k_res for end in found.uncertainty.interval)
    return 100 * w, 100 * w * low, 100 * w * high


def response_figure(found: Calibration, truth: Response | None = None) -> str:
    """The readings and w(eps) over strain, with a twin's `truth` if it is known; PNG as a data
    URI."""
    figure, axes = _figure(9, 5.6)
    r, d = found.readings, found.data
    for n, name in enumerate(dict.fromkeys(p.specimen for p in found.pieces)):
        color = _COLORS[n % len(_COLORS)]
        for place, mark in (("top", "^"), ("bottom", "v")):
            own = [i for i, p in enumerate(found.pieces) if (p.specimen, p.place) == (name, place)]
            shown = np.isin(d.piece, own)
            if shown.any():
                axes.plot(
                    100 * d.strain[shown], 100 * d.y[shown], mark, color=color, ms=5, alpha=0.55,
                    mew=0, label=f"{name}, {place} cord",
                )  # fmt: skip
    low, high = found.response.strain_range
    strain = np.linspace(low, high, 200)
    w, below, above = _band(found, strain)
    axes.fill_between(100 * strain, below, above, color="k", alpha=0.12, lw=0, label="95 %")
    if truth is not None:
        axes.plot(
            100 * strain, 100 * truth(strain), color="#c77700", ls="--", lw=2, label="the twin"
        )
    axes.plot(100 * strain, w, "k", lw=1.6, label=f"w(ε), {found.response.model}")
    axes.axhline(0, color="0.6", lw=0.7)
    axes.axvline(0, color="0.6", lw=0.7)
    top = axes.secondary_xaxis("top")
    radii = r.radii
    e = [float(np.abs(r.strain[r.radius == x]).max()) for x in radii]
    keep = [0]
    for i in range(1, len(radii)):
        if abs(e[keep[-1]] - e[i]) > 0.055 * (high - low):
            keep.append(i)
    top.set_xticks([100 * e[i] for i in keep], [f"{radii[i]:g}" for i in keep], fontsize=8)
    top.set_xlabel("surface radius of the jig, mm (outer cord)", fontsize=8, loc="right")
    axes.set_xlabel("strain ε, %")
    axes.set_ylabel("(R − R₀)/R₀, %")
    axes.legend(frameon=False, fontsize=9)
    return as_image(figure)


def _residuals(found: Calibration) -> str:
    figure, axes = _figure(9, 3.4)
    fit = found.trials[found.response.model].fit
    left = 100 * (found.data.y - fit.predict(found.data))
    for p, piece in enumerate(found.pieces):
        own = found.data.piece == p
        if own.any():
            axes.plot(100 * found.data.strain[own], left[own], ".", ms=5, alpha=0.6,
                      color=_COLORS[p % len(_COLORS)], label=piece.name)  # fmt: skip
    axes.axhspan(-100 * found.noise, 100 * found.noise, color="k", alpha=0.08, lw=0)
    axes.axhline(0, color="k", lw=0.8)
    axes.set_xlabel("strain ε, %")
    axes.set_ylabel("reading − fit, %")
    axes.legend(frameon=False, fontsize=8, ncols=4)
    return as_image(figure)


def _neutral(found: Calibration) -> str:
    figure, axes = _figure(9, 3.0)
    axes.plot(found.neutral_radius, 100 * found.neutral_changes, "o", color="#2e4057", ms=4,
              alpha=0.6)  # fmt: skip
    limit = 100 * found.drift.limit
    axes.axhspan(-limit, limit, color="#66a182", alpha=0.15, lw=0, label="what may be")
    axes.axhline(0, color="k", lw=0.8)
    axes.set_xlabel("surface radius of the jig, mm")
    axes.set_ylabel("neutral cord, %")
    axes.legend(frameon=False, fontsize=8)
    return as_image(figure)
