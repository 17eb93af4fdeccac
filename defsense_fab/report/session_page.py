"""Write the page about a processed session: markers, movement, signals and their quality."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..capture.sessions.results import ProcessedSession
from ..capture.sessions.session import CaptureSession
from ..core.arrays import Float
from .html import as_image, write_page

_MAX_FRAMES = 10_000  # of a curve: more cannot be distinguished on a page, and take much memory

_SYNC_METHODS = {
    "led": "the read-out board's LED in the pictures",
    "motion": "correlation of motion and signals (no LED was visible); the error does not include"
    " the cords' lag behind the body",
    "arrival": "arrival times of the samples; the cameras' delay is unknown",
    "none": "not compared: no read-out board was recorded",
}


def write_report(path: Path, session: CaptureSession, result: ProcessedSession) -> None:
    """Write a self-contained page about a processed session.

    Args:
        path: The file to write.
        session: The session.
        result: What processing it gave.

    Raises:
        StorageError: The file cannot be written.
    """
    figures = [
        ("Visible markers", _draw_visibility),
        ("Movement and signals", _draw_signals),
        ("Uncertainty and alignment", _draw_quality),
        ("Markers in the rest frame", _draw_positions),
    ]
    write_page(
        path,
        "session",
        device=session.device,
        warnings=_warnings(result.quality),
        rows=_rows(session, result.quality),
        figures=[(title, _draw(draw, session, result)) for title, draw in figures],
    )


def _warnings(quality: dict[str, Any]) -> list[str]:
    out = list(quality["warnings"])
    for run in quality["runs"]:
        out += [f"{run['run']}: {w}" for w in run["tracks"]["warnings"]]
        out += [f"{run['run']}: {w}" for w in run["sync"].get("notes", [])]
    out += [f"{s['run']} was excluded: {s['why']}" for s in quality["skipped"]]
    return out


def _rows(session: CaptureSession, quality: dict[str, Any]) -> list[tuple[str, str]]:
    def mm(value: float | None) -> str:
        return "-" if value is None else f"{value:.3f} mm"

    rows = [
        ("recorded", session.started_at),
        ("length", _length(quality)),
        ("aligned by", f"{quality['aligned_by']}, {quality['aligned_frames']:.0%} of the frames"),
        (
            "alignment residual",
            f"{mm(quality['residual']['median'])}, 95 % below {mm(quality['residual']['95 %'])}",
        ),
        (
            "standard deviation of a marker's position",
            f"{mm(quality['sigma']['median'])}, 95 % below {mm(quality['sigma']['95 %'])}",
        ),
    ]
    for run in quality["runs"]:
        sync = run["sync"]
        error = "unknown" if sync.get("error_ms") is None else f"{sync['error_ms']:.1f} ms"
        rows.append((f"{run['run']}: ended", run["ended"]))
        rows.append(
            (
                f"{run['run']}: clocks synchronized by",
                f"{_SYNC_METHODS[sync['method']]}; error {error}",
            )
        )
        rows.append(
            (
                f"{run['run']}: tags",
                f"{run['tracks']['by_several']:.0%} seen by several cameras,"
                f" {run['tracks']['by_one']:.0%} by one; {run['tracks']['impossible']} impossible"
                " positions removed",
            )
        )
    return rows


def _length(quality: dict[str, Any]) -> str:
    out = f"{quality['seconds']:.1f} s, {quality['frames']} frames"
    if quality["rate"] is None:
        return out + " at uneven intervals"
    return out + f" at {quality['rate']:.4g} Hz, {quality['dropped']} more dropped"


def _draw(
    draw: Callable[[Any, CaptureSession, ProcessedSession], None],
    session: CaptureSession,
    result: ProcessedSession,
) -> str:
    from matplotlib.figure import Figure

    figure = Figure((9.6, 4.2), dpi=100, layout="constrained")
    draw(figure, session, result)
    image = as_image(figure)
    figure.clear()  # its parts refer to each other and would stay in memory
    return image


def _draw_visibility(figure: Any, session: CaptureSession, result: ProcessedSession) -> None:
    axes = figure.subplots()
    t = result.aligned
    bins = min(len(t.time), 400)
    edges = np.linspace(0, len(t.time), bins + 1).astype(int)
    visible_share = np.array([t.visible[a : max(b, a + 1)].mean(0) for a, b in pairwise(edges)])
    image = axes.imshow(
        visible_share.T,
        aspect="auto",
        cmap="Greens",
        vmin=0,
        vmax=1,
        interpolation="nearest",
        extent=(t.time[0], t.time[-1], len(t.ids) - 0.5, -0.5),
    )
    names = [
        f"{i}{' (anchor)' if a else ''}" for i, a in zip(t.ids, session.markers.anchor, strict=True)
    ]
    axes.set_yticks(range(len(t.ids)), names, fontsize=8)
    axes.set_xlabel("s")
    axes.set_ylabel("tag")
    figure.colorbar(image, label="share of frames visible")


def _draw_signals(figure: Any, session: CaptureSession, result: ProcessedSession) -> None:
    above, below = figure.subplots(2, 1, sharex=True)
    t = result.aligned
    frames = _subsample(t.time)
    with np.errstate(all="ignore"):
        displacement = np.linalg.norm(t.points[frames] - session.markers.centers, axis=2)
    above.plot(t.time[frames], displacement, lw=0.8)
    above.set_ylabel("marker displacement, mm")
    for k, name in enumerate(session.channels):
        below.plot(t.time[frames], 100 * result.signals[frames, k], lw=0.8, label=name)
    below.set_ylabel("(R - R0)/R0, %")
    below.set_xlabel("s")
    if session.channels:
        below.legend(fontsize=8, ncols=4)


def _draw_quality(figure: Any, _: CaptureSession, result: ProcessedSession) -> None:
    left, right = figure.subplots(1, 2)
    t = result.aligned
    sigma = lengths(t.sigma)[t.visible]
    sigma = sigma[np.isfinite(sigma) & (sigma > 0)]
    if len(sigma):
        left.hist(np.log10(sigma), 60, color="#27c")
        ticks = np.arange(np.floor(np.log10(sigma.min())), np.ceil(np.log10(sigma.max())) + 1)
        left.set_xticks(ticks, [f"{10.0**x:g}" for x in ticks])
    left.set_xlabel("standard deviation of a position, mm")
    left.set_ylabel("positions")
    frames = _subsample(t.time)
    right.plot(t.time[frames], result.residual[frames], lw=0.7, color="#d60")
    right.set_xlabel("s")
    right.set_ylabel("alignment residual, mm")


def lengths(vectors: Float) -> Float:
    """Return the lengths (t, m) of vectors (t, m, 3), in chunks to save memory."""
    out = np.empty(vectors.shape[:2])
    for k in range(0, len(out), _MAX_FRAMES):
        out[k : k + _MAX_FRAMES] = np.linalg.norm(vectors[k : k + _MAX_FRAMES], axis=2)
    return out


def _subsample(time: Float) -> slice:
    """Return a slice of all frames, or of evenly spaced ones if there are many."""
    return slice(None, None, -(-len(time) // _MAX_FRAMES) or 1)


def _draw_positions(figure: Any, session: CaptureSession, result: ProcessedSession) -> None:
    views = figure.subplots(1, 3)
    points = result.aligned.points[_subsample(result.aligned.time)]
    for axes, (a, b) in zip(views, ((0, 1), (0, 2), (1, 2)), strict=True):
        for m in range(points.shape[1]):
            axes.plot(points[:, m, a], points[:, m, b], lw=0.6)
        axes.plot(*session.markers.centers[:, [a, b]].T, "k+", ms=5)
        axes.set_aspect("equal")
        axes.set_xlabel(f"{'xyz'[a]}, mm")
        axes.set_ylabel(f"{'xyz'[b]}, mm")
