"""Resistances at the times of a run's tracks, and at rest.

The clocks of a run are compared part by part: a read-out board that restarts in the middle of a run
has another clock from then on, so each part between two starts is synchronized separately.

Cords drift by per cents in hours, so each run has its own rest resistances R0, from its own rests.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from ...core.arrays import Bool, Float
from ...core.errors import CaptureError
from ...core.markers import Tracks
from ...decoding.signal_history import interpolate_at
from ...sensing.voltage_divider import conversion_time
from ..clocks.clock_fit import Clocks, fit_clocks
from ..clocks.synchronization import Sync, synchronize_by_led, synchronize_by_motion
from ..readout.recording import Recording
from .recorded_tags import CameraRecording
from .results import ClockPart
from .session import BOARD, CaptureSession


def rest_resistances(
    names: Sequence[str], channels: Sequence[str], ohm: Sequence[Float], rest: Sequence[Bool]
) -> tuple[Float, list[str]]:
    """Return the rest resistances of runs.

    R0 is the median at rest. A cord that was not measured at rest gets R0 of the nearest run that
    has one (of two, the earlier). If no run has one, it is the median over the whole session.

    Args:
        names: Names of the runs (r,).
        channels: Names of the channels (c,).
        ohm: Resistances of each run (t, c), ohm, NaN where not known.
        rest: Frames of each run at rest (t,).

    Returns:
        R0 (r, c), ohm, and warnings.
    """
    measured = np.array(
        [_finite_medians(R[is_resting]) for R, is_resting in zip(ohm, rest, strict=True)]
    )
    never_measured = ~np.isfinite(measured).any(axis=0)
    result, borrowed = measured.copy(), dict[tuple[int, int], list[str]]()
    result[:, never_measured] = _finite_medians(np.concatenate(ohm))[never_measured]
    warnings = [
        f"No rest of {channel} was measured in any run. Its R0 is the median of the session."
        for channel, is_missing in zip(channels, never_measured, strict=True)
        if is_missing and not never_measured.all()
    ]
    for k, R in enumerate(ohm):
        for c, channel in enumerate(channels):
            candidates = np.flatnonzero(np.isfinite(measured[:, c]))
            if np.isfinite(measured[k, c]) or not len(candidates) or not np.isfinite(R[:, c]).any():
                continue
            lender = int(candidates[np.abs(candidates - k).argmin()])
            result[k, c] = measured[lender, c]
            borrowed.setdefault((k, lender), []).append(channel)
    return result, warnings + [
        f"{names[k]}: no rest of {', '.join(names_of_channels)} was measured. R0 is that of"
        f" {names[lender]}, from which the cords may have drifted."
        for (k, lender), names_of_channels in borrowed.items()
    ]


def _finite_medians(values: Float) -> Float:
    """Return the medians of columns (n, c), NaN for those without a number."""
    finite = [v[np.isfinite(v)] for v in values.T]
    return np.array([float(np.median(v)) if len(v) else np.nan for v in finite])


MAX_DRIFT = 5e-4  # relative, of a read-out board's clock
MAX_DELAY_S = 0.01  # by which delays change the drift of a short part
MAX_CLOCK_ADVANCE_S = 0.2  # of the device's clock relative to the host's between two samples
MAX_DISTANCES = 10  # between markers, which show how a device moves
MIN_SAMPLES = 10  # of a recording; fewer are ignored
FRAME_MARGIN_S = 1.0  # of frames on each side of a part's samples


def synchronize_signals(
    session: CaptureSession,
    recording: Recording,
    cameras: Sequence[CameraRecording],
    start: int,
    shift: Sequence[float],
    tracks: Tracks,
) -> tuple[Float, dict[str, Any], list[ClockPart]]:
    """Return a run's resistances at the tracks' times, by the best comparison of clocks.

    Args:
        session: The session.
        recording: Samples of the run.
        cameras: Recordings of the cameras, with stamps in ns.
        start: The tracks' time zero, ns.
        shift: Time that was added to each camera's stamps, s.
        tracks: The tracks.

    Returns:
        Resistances (t, c), ohm, a record of the comparison for `quality.json`, and the relation of
        clocks in each part.
    """
    ohm = resistances(session, recording)
    result = np.full((len(tracks.time), ohm.shape[1]), np.nan)
    if len(recording.counter) <= MIN_SAMPLES:
        return result, {"method": "none"}, []
    ends = np.unique([0, *restarts(recording), *_clock_jumps(recording), len(recording.counter)])
    parts = [slice(int(a), int(b)) for a, b in pairwise(ends)]
    parts = [p for p in parts if p.stop - p.start > MIN_SAMPLES]
    records, clocks = [], []
    for part in parts:
        board_time, record = _synchronize_part(recording, part, ohm, cameras, start, shift, tracks)
        values = resistances_at(board_time, recording.device_us[part] / 1e6, ohm[part])
        result = np.where(np.isfinite(values), values, result)
        records.append(record)
        clocks.append(ClockPart(part, record["offset"], record["drift"]))
    if len(records) < 2:
        return result, records[0], clocks
    longest = records[int(np.argmax([p.stop - p.start for p in parts]))]
    errors = [r["error_ms"] for r in records]
    record = longest | {
        "error_ms": None if None in errors else max(errors),
        "parts": records,
        "notes": [
            f"The read-out board's clock restarted in this run. Its {len(records)} parts are"
            " synchronized separately.",
            *dict.fromkeys(note for r in records for note in r["notes"]),
        ],
    }
    return result, record, clocks


def restarts(recording: Recording) -> list[int]:
    """Return the samples before which the read-out board restarted."""
    return [n for n, e in recording.events if e.get("event") == "restart"]


def _clock_jumps(recording: Recording) -> list[int]:
    """Return the samples before which the read-out board's clock went back, or ahead of the host's.

    Damaged files do not state that the board restarted.
    """
    device, host = np.diff(recording.device_us) / 1e6, np.diff(recording.host_ns) / 1e9
    return [
        int(k) + 1 for k in np.flatnonzero((device < 0) | (device > host + MAX_CLOCK_ADVANCE_S))
    ]


def resistances(session: CaptureSession, recording: Recording) -> Float:
    """Return the resistances of a recording's samples (n, c), ohm.

    Raises:
        CaptureError: If it has other channels, or no event states the board's full scale.
    """
    if recording.sums.shape[1] != len(session.channels):
        raise CaptureError(
            f"has {recording.sums.shape[1]} channels, but the session has {len(session.channels)}",
            code="channels-differ",
            where=recording.path,
            action=f"Use the {BOARD} of this session",
            channels=len(session.channels),
            count=recording.sums.shape[1],
        )
    return recording.resistances(np.array(session.reference))


def _synchronize_part(
    recording: Recording,
    part: slice,
    ohm: Float,
    cameras: Sequence[CameraRecording],
    start: int,
    shift: Sequence[float],
    tracks: Tracks,
) -> tuple[Float, dict[str, Any]]:
    """Return the board's times (t,), s, at the tracks' times, and a record of the comparison.

    The clock does not jump in a part (`_clock_jumps`); where samples are missing, it continued.
    """
    device, host = recording.device_us[part] / 1e6, (recording.host_ns[part] - start) / 1e9
    arrival = fit_clocks(device, host)
    sync, notes = _synchronize_by_leds(recording, part, cameras, start, shift, arrival)
    if sync is None:
        is_near = _frames_near(tracks.time, host)
        try:
            sync = synchronize_by_motion(
                tracks.time[is_near],
                marker_distances(tracks)[is_near],
                device,
                ohm[part],
                arrival,
                max_gap=None,
            )
        except CaptureError as error:
            notes.append(str(error))
    if sync is not None:
        board_time, record = sync.to_device(tracks.time), sync_record(sync, notes)
    else:  # by the arrival of samples, without the cameras' own delay
        board_time = (tracks.time - arrival.offset) / (1 + arrival.drift)
        record = {
            "method": "arrival",
            "offset": arrival.offset,
            "drift": arrival.drift,
            "error_ms": None,
            "notes": notes,
        }
    if abs(record["drift"]) > max(MAX_DRIFT, MAX_DELAY_S / max(float(np.ptp(device)), MAX_DELAY_S)):
        record["error_ms"] = None
        record["notes"] = [
            *record["notes"],
            "The read-out board's clock jumped in this run, so signals may be tens of ms off."
            " Record it again.",
        ]
    return board_time, record


def _synchronize_by_leds(
    recording: Recording,
    part: slice,
    cameras: Sequence[CameraRecording],
    start: int,
    shift: Sequence[float],
    arrival: Clocks,
) -> tuple[Sync | None, list[str]]:
    """Synchronize by the camera that shows the LED best; return notes on the others."""
    device, host = recording.device_us[part] / 1e6, (recording.host_ns[part] - start) / 1e9
    best: Sync | None = None
    notes: list[str] = []
    for k, camera in enumerate(cameras):
        time = (camera.time - start) / 1e9 + shift[k]
        is_near = _frames_near(time, host)
        if np.isfinite(camera.led[is_near]).sum() < 30:
            continue
        try:
            sync = synchronize_by_led(
                time[is_near],
                camera.led[is_near],
                device,
                recording.led[part].astype(bool),
                arrival,
                conversion=_conversion(recording),
            )
        except CaptureError as error:
            notes.append(str(error))
            continue
        if best is None or sync.error < best.error:
            best = sync
    return best, notes


def _frames_near(time: Float, host: Float) -> Bool:
    """Return the frames (t,) while samples arrived, with a margin."""
    return np.asarray((time >= host[0] - FRAME_MARGIN_S) & (time <= host[-1] + FRAME_MARGIN_S))


def _conversion(recording: Recording) -> float:
    """Return the time that the conversions of a sample take, s, by the board's description."""
    for _, e in recording.events:
        if {"converter", "channels", "averages"} <= set(e):
            return conversion_time(int(e["converter"]), int(e["channels"]), int(e["averages"]))
    return 0.0


def sync_record(sync: Sync, notes: Sequence[str]) -> dict[str, Any]:
    """Return a comparison of clocks for `quality.json`."""
    return {
        "method": sync.method,
        "offset": sync.offset,
        "drift": sync.drift,
        "error_ms": 1e3 * sync.error,
        "evidence": sync.evidence,
        "notes": list(notes),
    }


def marker_distances(tracks: Tracks) -> Float:
    """Return distances (t, d) between markers that are visible often: those that change most.

    They do not change when the device moves as a whole.
    """
    share = tracks.visible.mean(axis=0)
    frequent = np.argsort(-share)[:8]
    frequent = frequent[share[frequent] > 0.5]
    if len(frequent) < 2:
        raise CaptureError(
            "too few markers are visible often enough to show how the device moves",
            code="too-few-markers",
            where="synchronization",
            action="Keep more markers in view of the cameras",
        )
    first, second = np.triu_indices(len(frequent), 1)
    distances = np.stack(
        [
            np.linalg.norm(tracks.points[:, i] - tracks.points[:, j], axis=1)
            for i, j in zip(frequent[first], frequent[second], strict=True)
        ],
        axis=1,
    )
    largest = np.argsort(-np.nanstd(distances, axis=0))[:MAX_DISTANCES]
    return np.asarray(distances[:, largest])


def resistances_at(times: Float, time: Float, ohm: Float) -> Float:
    """Interpolate resistances linearly.

    Samples whose time is not later than the previous one's are left out.

    Args:
        times: Times at which to interpolate (t,), s.
        time: Times of the samples (n,), s.
        ohm: Resistances of the samples (n, c), ohm.

    Returns:
        Resistances (t, c), ohm, NaN outside and where more than four samples are missing.
    """
    is_later = np.append(True, np.diff(time) > 0)
    time, ohm = time[is_later], ohm[is_later]
    return interpolate_at(times, time, ohm, max_gap=5 * float(np.median(np.diff(time))))
