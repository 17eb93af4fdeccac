"""Tracks of others in the device's frame, by the markers whose places are known."""

from __future__ import annotations

import numpy as np

from ...capture.sessions.rest_frame import lay_on_rest
from ...capture.tracking.rest_pose import FAR
from ...core.arrays import Bool, Float
from ...core.errors import CaptureError, TrainingError
from ...core.markers import Markers, Tracks

_ANCHOR = 3  # markers that do not move with the device, that tell its frame


def in_design_frame(
    tracks: Tracks, markers: Markers, early: Bool, source: str
) -> tuple[Tracks, list[str]]:
    """Tracks of the `markers` in their device's frame, and what was done: as they are where the
    anchor's markers already are in their places, else laid onto them frame by frame (Kabsch). The
    device is at rest in the frames `early` (t,). Raises TrainingError for other markers, or other
    places than theirs."""
    known = np.isin(markers.ids, tracks.ids)
    if known.sum() < _ANCHOR:
        have, want = (", ".join(map(str, i.tolist())) for i in (tracks.ids, markers.ids))
        raise TrainingError(
            f"{source}: its markers are {have}, the device's are {want}; name them by these numbers"
            " (tag_1, tag_2, ...)"
        )
    points, sigma = np.full((2, len(tracks.time), len(markers.ids), 3), np.nan)
    at = [tracks.ids.tolist().index(i) for i in markers.ids[known].tolist()]
    points[:, known], sigma[:, known] = tracks.points[:, at], tracks.sigma[:, at]
    named = Tracks(tracks.time, markers.ids, points, sigma, tracks.frame)
    off, by = _off(points, markers, early)
    if off <= FAR:
        return named, [f"in the device's frame as given: {by} {off:.2f} mm off"]
    corners = np.full((len(points), int(markers.anchor.sum()), 4, 3), np.nan, np.float32)
    try:
        laid = lay_on_rest(markers, named, corners, early, "auto")
    except CaptureError as error:
        raise TrainingError(
            f"{source}: is not in the device's frame ({by} {off:.1f} mm off), and cannot be laid"
            f" onto its rest pose, which must be at the beginning, in mm: {error}"
        ) from None
    left, by = _off(laid.aligned.points, markers, early)
    if not left <= FAR:
        raise TrainingError(
            f"{source}: is not in the device's frame, and its markers do not have the places of"
            f" markers.json: {by} {left:.1f} mm off; check the markers' numbers and the tracks'"
            " unit, and that the device rests at the beginning"
        )
    told = f"aligned by {laid.by}, from {off:.1f} mm off: {by} {left:.2f} mm off"
    moved = laid.aligned.points
    spread = np.where(np.isfinite(sigma), laid.aligned.sigma, np.nan)
    back = Tracks(tracks.time, markers.ids, moved, spread, tracks.frame)
    return back, [told, *laid.warnings]


def _off(points: Float, markers: Markers, early: Bool) -> tuple[float, str]:
    """By how much markers are not in their places in the median, mm, and which: those of the anchor
    at all times, or all at rest."""
    off = np.linalg.norm(points - markers.centers, axis=2)
    which, told = markers.anchor, "the anchor's markers are"
    if np.isfinite(off[:, which]).any(axis=0).sum() < _ANCHOR:
        off, which, told = off[early], np.ones(len(markers.ids), bool), "markers at rest are"
    found = off[:, which]
    found = found[np.isfinite(found)]
    return (float(np.median(found)) if len(found) else np.inf), told
