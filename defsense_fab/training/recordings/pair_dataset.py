"""Datasets of two files: signals, and tracks of any motion-capture system."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ...capture.clocks.synchronization import synchronize_by_motion
from ...capture.files.formats import read_tracks
from ...capture.sessions.rest_frame import lay_on_rest
from ...capture.sessions.signals import motion
from ...capture.tracking.rest_pose import MAX_DISTANCE_MM
from ...core.arrays import Bool, Float
from ...core.errors import CaptureError, TrainingError
from ...core.markers import Markers, Tracks
from ..data.dataset import Dataset, Recording
from .series import Series, read_series
from .session_dataset import rising

# Tracks of others in the device's frame, by the markers whose places are known.

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
    if off <= MAX_DISTANCE_MM:
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
    if not left <= MAX_DISTANCE_MM:
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


Offset = float | Literal["auto"]
#: s at the beginning, in which the device is taken to rest where nothing else tells.
QUIET = 3.0
_KEPT = 0.99  # of the samples must follow each other in time
_LONGER = 0.1  # of the samples' time, by which they go on after the tracks
_STILL = 1.0  # mm, root mean square, by which markers at rest are off their places


def pair_dataset(
    signals: Path, tracks: Path, *, device: str | None = None, layout: str = "", unit: str = "",
    markers: Markers | None = None, offset: Offset = 0.0, quiet: float = QUIET, called: str = "",
) -> Dataset:  # fmt: skip
    """One recording of a table of `signals` (see `series.read_series`) and a file of `tracks`
    (.csv, .npz, .parquet, .c3d, .trc), whose markers are named by their numbers.

    tracks' time = signals' time + `offset` s; "auto" finds it by how motion and signals go
    together. With `markers`, tracks in another frame than the device's are laid onto its rest pose.
    The device rests in the first `quiet` s; its name is `device`, the markers', or what it is
    `called` where those do not tell. Raises TrainingError, CaptureError."""
    return of_series(
        read_series(signals), read_tracks(tracks), str(tracks), device=device, layout=layout,
        unit=unit, markers=markers, offset=offset, quiet=quiet, called=called,
    )  # fmt: skip


def of_series(
    series: Series, tracks: Tracks, source: str, *, device: str | None, layout: str, unit: str,
    markers: Markers | None, offset: Offset, quiet: float, called: str,
) -> Dataset:  # fmt: skip
    """The same of what was read, the tracks from the file `source`."""
    if len(tracks.time) < 2 or not tracks.seen.any():
        raise TrainingError(f"{source}: no marker was seen in {len(tracks.time)} frames")
    kept = rising(series.time)
    if kept.sum() < _KEPT * len(kept):
        first = int(np.argmin(kept))
        raise TrainingError(
            f"{series.source}: {len(kept) - int(kept.sum())} of {len(kept)} samples are not later"
            f" than those before; the first is sample {first + 1}, at {series.time[first]:.3f} s."
            " Are these several takes? Give each by itself"
        )
    series = _part(series, kept)
    time, error, how = _in_step(series, tracks, source, offset)
    if time[-1] < tracks.time[0] or time[0] > tracks.time[-1]:
        raise TrainingError(
            f"{series.source} and {source} have no time in common ({time[0]:.1f} to {time[-1]:.1f}"
            f" s, {tracks.time[0]:.1f} to {tracks.time[-1]:.1f} s); give the offset between them,"
            " or let it be found (auto)"
        )
    begin = max(float(tracks.time[0]), float(time[0]))
    early = np.asarray(tracks.time <= begin + quiet)
    notes: list[str] = []
    if markers is None:
        rest = _medians(tracks.points, early)
        notes.append(
            f"markers at rest: where they are in the first {quiet:g} s; the tracks are taken to be"
            " in the device's frame"
        )
        moved = _spread(tracks.points, rest, early)
        if moved > _STILL:
            notes.append(
                f"markers move by {moved:.0f} mm in the first {quiet:g} s, which are taken for the"
                " rest: places at rest and R0 are wrong; begin with a rest, or give markers.json"
            )
    else:
        tracks, told = in_design_frame(tracks, markers, early, source)
        rest = markers.centers
        notes += told
    beyond = float(time[-1] - tracks.time[-1])
    if beyond > max(_LONGER * float(np.ptp(time)), quiet):
        notes.append(
            f"the tracks end {beyond:.0f} s before the signals: see whether {source} is cut off"
        )
    resting, when = early, f"of the first {quiet:g} s"
    if markers is not None:
        still = _still(tracks, rest)
        lasted = float(still.mean()) * float(np.ptp(tracks.time))
        if lasted > 0.5:
            resting, when = still, f"of the {lasted:.1f} s in which the markers are at rest"
    R0, why = series.rest(_beside(time, tracks.time, resting))
    notes.append(f"R0: {why}" + (f" ({when})" if why.endswith("at rest") else ""))
    ohm = series.ohm if series.ohm is not None else R0 * (1 + _changes(series))
    name = device or (markers.device if markers is not None else called or Path(source).stem)
    recording = Recording(
        series.source, series.source, unit or name, time, ohm, R0, tracks.time, tracks.points,
        tracks.sigma, error,
    )  # fmt: skip
    about: dict[str, Any] = {
        "folder": series.source, "tracks": source, "device": name, "unit": unit, "layout": layout,
        "offset": how, "notes": notes,
    }  # fmt: skip
    return Dataset(
        name, layout, series.channels, tracks.ids, rest, (recording,), {"sessions": [about]}
    )


def _part(series: Series, kept: Bool) -> Series:
    def rows(values: Float | None) -> Float | None:
        return None if values is None else values[kept]

    return replace(series, time=series.time[kept], ohm=rows(series.ohm), change=rows(series.change))


def _changes(series: Series) -> Float:
    assert series.change is not None
    return series.change


def _in_step(
    series: Series, tracks: Tracks, source: str, offset: Offset
) -> tuple[Float, float | None, str]:
    """The samples' times on the tracks' clock (n,) s, the standard error of that, where it is
    known, and how it was found."""
    if offset != "auto":
        return series.time + float(offset), None, f"{float(offset):g} s, as given"
    values = series.ohm if series.ohm is not None else _changes(series)
    try:
        sync = synchronize_by_motion(tracks.time, motion(tracks), series.time, values)
    except CaptureError as error:
        raise TrainingError(
            f"{series.source} and {source}: no offset is found by motion ({error}); give it"
        ) from None
    told = f"{sync.offset:.4f} s and a drift of {sync.drift:.2e}, by motion"
    return sync.to_camera(series.time), sync.error, told


def _medians(points: Float, frames: Bool) -> Float:
    """Where markers are (m, 3) mm in some frames, or in all where they were not seen in those."""
    out = np.full(points.shape[1:], np.nan)
    for part in (points[frames], points):
        for k in np.flatnonzero(np.isnan(out[:, 0])):
            seen = part[np.isfinite(part[:, k, 0]), k]
            if len(seen):
                out[k] = np.median(seen, axis=0)
    return out


def _spread(points: Float, rest: Float, frames: Bool) -> float:
    """How far markers (t, m, 3) mm are off their places (m, 3) in some frames: root mean square."""
    squares = ((points[frames] - rest) ** 2).sum(axis=2)
    known = squares[np.isfinite(squares)]
    return float(np.sqrt(known.mean())) if len(known) else 0.0


def _still(tracks: Tracks, rest: Float) -> Bool:
    """Frames (t,) in which at least three markers are seen, all at their places at rest."""
    with np.errstate(all="ignore"):
        off = np.linalg.norm(tracks.points - rest, axis=2)
        seen = np.isfinite(off)
        rms = np.sqrt(np.where(seen, off**2, 0).sum(axis=1) / seen.sum(axis=1))
    return np.asarray((seen.sum(axis=1) >= 3) & (rms < _STILL))


def _beside(when: Float, time: Float, flags: Bool) -> Bool:
    """The flag (t,) of the nearest frame for each sample (n,); none beyond the frames."""
    k = np.clip(np.searchsorted(time, when), 1, len(time) - 1)
    k -= when - time[k - 1] < time[k] - when
    inside = (when >= time[0]) & (when <= time[-1])
    return np.asarray(flags[k] & inside)
