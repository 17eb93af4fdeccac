"""Render the page about a cord's response: readings, residuals and the neutral cord."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..calibration.calibrate import Calibration
from ..sensing.response import Response, build_response
from .html import as_image, render
from .pictures.sheet import COLORS


def page(calibration: Calibration, data: Mapping[str, Any]) -> str:
    """Render the page of a calibration.

    Args:
        calibration: The calibration.
        data: Content of its `response.json`.

    Returns:
        Self-contained HTML.
    """
    images = {"response": response_figure(calibration), "residuals": _residuals(calibration)}
    if len(calibration.neutral_changes):
        images["neutral"] = _neutral(calibration)
    return render("calibration", data=data, images=images, drift=calibration.drift)


def _figure(width: float = 9.0, height: float = 5.0) -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure((width, height), dpi=110, layout="constrained")
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25)
    return figure, axes


def _band(calibration: Calibration, strain: Any) -> tuple[Any, Any, Any]:
    """Return w and its 95 % interval in percent; the slope's uncertainty grows with strain."""
    w = build_response(calibration.response)(strain)
    low, high = (end / calibration.k_res for end in calibration.uncertainty.interval)
    return 100 * w, 100 * w * low, 100 * w * high


def response_figure(calibration: Calibration, truth: Response | None = None) -> str:
    """Plot the readings and w(eps) over strain, as Fig. 3 of DefSense (CHI 2016).

    Args:
        calibration: The calibration.
        truth: True response of a digital twin, or None.

    Returns:
        A PNG data URI.
    """
    figure, axes = _figure(9, 5.6)
    readings, data = calibration.readings, calibration.data
    for n, name in enumerate(dict.fromkeys(p.specimen for p in calibration.pieces)):
        color = COLORS[n % len(COLORS)]
        for place, marker in (("top", "^"), ("bottom", "v")):
            pieces = [
                i
                for i, p in enumerate(calibration.pieces)
                if (p.specimen, p.place) == (name, place)
            ]
            is_shown = np.isin(data.piece, pieces)
            if is_shown.any():
                axes.plot(
                    100 * data.strain[is_shown],
                    100 * data.y[is_shown],
                    marker,
                    color=color,
                    ms=5,
                    alpha=0.55,
                    mew=0,
                    label=f"{name}, {place} cord",
                )
    low, high = calibration.response.strain_range
    strain = np.linspace(low, high, 200)
    w, below, above = _band(calibration, strain)
    axes.fill_between(100 * strain, below, above, color="k", alpha=0.12, lw=0, label="95 %")
    if truth is not None:
        axes.plot(
            100 * strain, 100 * truth(strain), color="#c77700", ls="--", lw=2, label="true response"
        )
    axes.plot(100 * strain, w, "k", lw=1.6, label=f"w(ε), {calibration.response.model}")
    axes.axhline(0, color="0.6", lw=0.7)
    axes.axvline(0, color="0.6", lw=0.7)
    top = axes.secondary_xaxis("top")
    radii = readings.radii
    strains = [float(np.abs(readings.strain[readings.radius == x]).max()) for x in radii]
    labelled = [0]
    for i in range(1, len(radii)):
        if abs(strains[labelled[-1]] - strains[i]) > 0.055 * (high - low):
            labelled.append(i)
    top.set_xticks(
        [100 * strains[i] for i in labelled], [f"{radii[i]:g}" for i in labelled], fontsize=8
    )
    top.set_xlabel("surface radius of the jig, mm (outer cord)", fontsize=8, loc="right")
    axes.set_xlabel("strain ε, %")
    axes.set_ylabel("(R − R₀)/R₀, %")
    axes.legend(frameon=False, fontsize=9)
    return as_image(figure)


def _residuals(calibration: Calibration) -> str:
    figure, axes = _figure(9, 3.4)
    fit = calibration.trials[calibration.response.model].fit
    residuals = 100 * (calibration.data.y - fit.predict(calibration.data))
    for p, piece in enumerate(calibration.pieces):
        is_piece = calibration.data.piece == p
        if is_piece.any():
            axes.plot(
                100 * calibration.data.strain[is_piece],
                residuals[is_piece],
                ".",
                ms=5,
                alpha=0.6,
                color=COLORS[p % len(COLORS)],
                label=piece.name,
            )
    axes.axhspan(-100 * calibration.noise, 100 * calibration.noise, color="k", alpha=0.08, lw=0)
    axes.axhline(0, color="k", lw=0.8)
    axes.set_xlabel("strain ε, %")
    axes.set_ylabel("reading − fit, %")
    axes.legend(frameon=False, fontsize=8, ncols=4)
    return as_image(figure)


def _neutral(calibration: Calibration) -> str:
    figure, axes = _figure(9, 3.0)
    axes.plot(
        calibration.neutral_radius,
        100 * calibration.neutral_changes,
        "o",
        color="#2e4057",
        ms=4,
        alpha=0.6,
    )
    limit = 100 * calibration.drift.limit
    axes.axhspan(-limit, limit, color="#66a182", alpha=0.15, lw=0, label="tolerance")
    axes.axhline(0, color="k", lw=0.8)
    axes.set_xlabel("surface radius of the jig, mm")
    axes.set_ylabel("neutral cord, %")
    axes.legend(frameon=False, fontsize=8)
    return as_image(figure)
