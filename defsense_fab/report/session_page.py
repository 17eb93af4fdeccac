"""What a processed session is worth, as a page to look at."""

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

_DRAWN = 10_000  # frames of a curve: more are not told apart on a page, and take much memory

_SYNC = {
    "led": "the read-out board's LED in the pictures",
    "motion": "how motion and signals go together (no LED was seen); what the cords lag behind the"
    " body is not in the error",
    "arrival": "when samples arrived: the cameras' own delay is not known",
    "none": "no read-out board was recorded",
}


def write_report(path: Path, session: CaptureSession, result: ProcessedSession) -> None:
    """One self-contained page."""
    figures = [
        ("Markers seen", _seen), ("Movement and signals", _course),
        ("Uncertainty and alignment", _quality), ("Markers in the rest frame", _places),
    ]  # fmt: skip
    write_page(
        path,
        "session",
        device=session.device,
        warnings=_warnings(result.quality),
        rows=_rows(session, result.quality),
        figures=[(title, _draw(draw, session, result)) for title, draw in figures],
    )


def _warnings(q: dict[str, Any]) -> list[str]:
    out = list(q["warnings"])
    for run in q["runs"]:
        out += [f"{run['run']}: {w}" for w in run["tracks"]["warnings"]]
        out += [f"{run['run']}: {w}" for w in run["sync"].get("notes", [])]
    out += [f"{s['run']} was left out: {s['why']}" for s in q["skipped"]]
    return out


def _rows(session: CaptureSession, q: dict[str, Any]) -> list[tuple[str, str]]:
    def mm(value: float | None) -> str:
        return "-" if value is None else f"{value:.3f} mm"

    rows = [
        ("recorded", session.started_at),
        ("length", _length(q)),
        ("aligned by", f"{q['aligned_by']}, {q['aligned_frames']:.0%} of the frames"),
        ("residual of the alignment",
         f"{mm(q['residual']['median'])}, 95 % below {mm(q['residual']['95 %'])}"),
        ("standard deviation of a marker's place",
         f"{mm(q['sigma']['median'])}, 95 % below {mm(q['sigma']['95 %'])}"),
    ]  # fmt: skip
    for run in q["runs"]:
        s = run["sync"]
        error = "not known" if s.get("error_ms") is None else f"{s['error_ms']:.1f} ms"
        rows.append((f"{run['run']}: ended", run["ended"]))
        rows.append((f"{run['run']}: clocks compared by", f"{_SYNC[s['method']]}; error {error}"))
        rows.append(
            (f"{run['run']}: tags",
             f"{run['tracks']['by_several']:.0%} by several cameras, {run['tracks']['by_one']:.0%}"
             f" by one, {run['tracks']['impossible']} impossible ones taken out")
        )  # fmt: skip
    return rows


def _length(q: dict[str, Any]) -> str:
    out = f"{q['seconds']:.1f} s, {q['frames']} frames"
    if q["rate"] is None:
        return out + " at uneven times"
    return out + f" at {q['rate']:.4g} Hz, {q['dropped']} more were dropped"


def _draw(draw: Callable[[Any, CaptureSession, ProcessedSession], None], session: CaptureSession,
          result: ProcessedSession) -> str:  # fmt: skip
    from matplotlib.figure import Figure

    figure = Figure((9.6, 4.2), dpi=100, layout="constrained")
    draw(figure, session, result)
    image = as_image(figure)
    figure.clear()  # its parts refer to each other, and would be in memory beside the next one's
    return image


def _seen(figure: Any, session: CaptureSession, result: ProcessedSession) -> None:
    axes = figure.subplots()
    t = result.aligned
    bins = min(len(t.time), 400)
    edges = np.linspace(0, len(t.time), bins + 1).astype(int)
    share = np.array([t.visible[a : max(b, a + 1)].mean(0) for a, b in pairwise(edges)])
    image = axes.imshow(
        share.T, aspect="auto", cmap="Greens", vmin=0, vmax=1, interpolation="nearest",
        extent=(t.time[0], t.time[-1], len(t.ids) - 0.5, -0.5),
    )  # fmt: skip
    names = [
        f"{i}{' (anchor)' if a else ''}" for i, a in zip(t.ids, session.markers.anchor, strict=True)
    ]
    axes.set_yticks(range(len(t.ids)), names, fontsize=8)
    axes.set_xlabel("s")
    axes.set_ylabel("tag")
    figure.colorbar(image, label="seen")


def _course(figure: Any, session: CaptureSession, result: ProcessedSession) -> None:
    above, below = figure.subplots(2, 1, sharex=True)
    t = result.aligned
    some = _some(t.time)
    with np.errstate(all="ignore"):
        moved = np.linalg.norm(t.points[some] - session.markers.centers, axis=2)
    above.plot(t.time[some], moved, lw=0.8)
    above.set_ylabel("marker moved, mm")
    for k, name in enumerate(session.channels):
        below.plot(t.time[some], 100 * result.signals[some, k], lw=0.8, label=name)
    below.set_ylabel("(R - R0)/R0, %")
    below.set_xlabel("s")
    if session.channels:
        below.legend(fontsize=8, ncols=4)


def _quality(figure: Any, _: CaptureSession, result: ProcessedSession) -> None:
    left, right = figure.subplots(1, 2)
    t = result.aligned
    sigma = lengths(t.sigma)[t.visible]
    sigma = sigma[np.isfinite(sigma) & (sigma > 0)]
    if len(sigma):
        left.hist(np.log10(sigma), 60, color="#27c")
        ticks = np.arange(np.floor(np.log10(sigma.min())), np.ceil(np.log10(sigma.max())) + 1)
        left.set_xticks(ticks, [f"{10.0**x:g}" for x in ticks])
    left.set_xlabel("standard deviation of a place, mm")
    left.set_ylabel("places")
    some = _some(t.time)
    right.plot(t.time[some], result.residual[some], lw=0.7, color="#d60")
    right.set_xlabel("s")
    right.set_ylabel("residual of the alignment, mm")


def lengths(vectors: Float) -> Float:
    """Of many (t, m, 3): (t, m), some at a time."""
    out = np.empty(vectors.shape[:2])
    for k in range(0, len(out), _DRAWN):
        out[k : k + _DRAWN] = np.linalg.norm(vectors[k : k + _DRAWN], axis=2)
    return out


def _some(time: Float) -> slice:
    """All frames, or of many some, evenly spaced."""
    return slice(None, None, -(-len(time) // _DRAWN) or 1)


def _places(figure: Any, session: CaptureSession, result: ProcessedSession) -> None:
    views = figure.subplots(1, 3)
    points = result.aligned.points[_some(result.aligned.time)]
    for axes, (a, b) in zip(views, ((0, 1), (0, 2), (1, 2)), strict=True):
        for m in range(points.shape[1]):
            axes.plot(points[:, m, a], points[:, m, b], lw=0.6)
        axes.plot(*session.markers.centers[:, [a, b]].T, "k+", ms=5)
        axes.set_aspect("equal")
        axes.set_xlabel(f"{'xyz'[a]}, mm")
        axes.set_ylabel(f"{'xyz'[b]}, mm")
