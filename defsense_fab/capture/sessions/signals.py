"""Resistances at the times of a run's tracks: its clocks are compared, part by part.

A read-out board that starts anew in the middle of a run has another clock from then on; so each
part between two starts is put in step by itself."""

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
from .sample_table import ClockPart
from .session import BOARD, CaptureSession

_DRIFTS = 5e-4  # relative: no read-out board's clock is off by more
_LATE = 0.01  # s: what delays do to a short part's drift
_AHEAD = 0.2  # s, by which no sample comes before its time
_DISTANCES = 10  # between markers, that tell how a device moves
_FEW = 10  # samples that are not yet a recording
_BESIDE = 1.0  # s of frames beside a part's samples that are compared with it


def signals_in_step(
    session: CaptureSession, recording: Recording, cameras: Sequence[CameraRecording], start: int,
    shift: Sequence[float], tracks: Tracks,
) -> tuple[Float, dict[str, Any], list[ClockPart]]:  # fmt: skip
    """Resistances (t, c) ohm at the tracks' times, by whichever way the clocks can be compared,
    what there is to tell of it, and how the clock of each part goes. `cameras` with stamps in ns,
    of which `start` is the tracks' zero; `shift` s that each camera's stamps are late by."""
    ohm = resistances(session, recording)
    out = np.full((len(tracks.time), ohm.shape[1]), np.nan)
    if len(recording.counter) <= _FEW:
        return out, {"method": "none"}, []
    ends = np.unique([0, *restarts(recording), *_jumps(recording), len(recording.counter)])
    parts = [slice(int(a), int(b)) for a, b in pairwise(ends)]
    parts = [p for p in parts if p.stop - p.start > _FEW]
    told, clocks = [], []
    for part in parts:
        at, about = _part(recording, part, ohm, cameras, start, shift, tracks)
        values = resistances_at(at, recording.device_us[part] / 1e6, ohm[part])
        out = np.where(np.isfinite(values), values, out)
        told.append(about)
        clocks.append(ClockPart(part, about["offset"], about["drift"]))
    if len(told) < 2:
        return out, told[0], clocks
    longest = told[int(np.argmax([p.stop - p.start for p in parts]))]
    errors = [t["error_ms"] for t in told]
    about = longest | {
        "error_ms": None if None in errors else max(errors),
        "parts": told,
        "notes": [
            f"the read-out board's clock began anew in this run: its {len(told)} parts are each"
            " in step by themselves",
            *dict.fromkeys(note for t in told for note in t["notes"]),
        ],
    }
    return out, about, clocks


def restarts(recording: Recording) -> list[int]:
    """The samples before which the read-out board began anew."""
    return [n for n, e in recording.events if e.get("event") == "restart"]


def _jumps(recording: Recording) -> list[int]:
    """The samples before which the read-out board's clock went back, or ahead of the time that
    passed: damaged files, that do not say that it began anew."""
    device, host = np.diff(recording.device_us) / 1e6, np.diff(recording.host_ns) / 1e9
    return [int(k) + 1 for k in np.flatnonzero((device < 0) | (device > host + _AHEAD))]


def resistances(session: CaptureSession, recording: Recording) -> Float:
    """(n, c) ohm of a recording's samples. Raises CaptureError for other channels, and where no
    event tells the read-out board's full scale."""
    if recording.sums.shape[1] != len(session.channels):
        raise CaptureError(
            f"{BOARD} has {recording.sums.shape[1]} channels, the session"
            f" {len(session.channels)}: it does not belong here"
        )
    return recording.resistances(np.array(session.reference))


def _part(
    recording: Recording, part: slice, ohm: Float, cameras: Sequence[CameraRecording], start: int,
    shift: Sequence[float], tracks: Tracks,
) -> tuple[Float, dict[str, Any]]:  # fmt: skip
    """The read-out board's times (t,) s at the tracks' by samples between two starts, and how that
    is known. Its clock does not jump in a part (`_jumps`): where samples lack, it went on."""
    device, host = recording.device_us[part] / 1e6, (recording.host_ns[part] - start) / 1e9
    arrival = fit_clocks(device, host)
    sync, why = _by_leds(recording, part, cameras, start, shift, arrival)
    if sync is None:
        near = _near(tracks.time, host)
        try:
            sync = synchronize_by_motion(
                tracks.time[near], motion(tracks)[near], device, ohm[part], arrival, max_gap=None
            )
        except CaptureError as error:
            why.append(str(error))
    if sync is not None:
        at, about = sync.to_device(tracks.time), told_of(sync, why)
    else:  # what remains: when samples arrived, which cameras' own delay is not in
        at = (tracks.time - arrival.offset) / (1 + arrival.drift)
        about = {
            "method": "arrival", "offset": arrival.offset, "drift": arrival.drift,
            "error_ms": None, "notes": why,
        }  # fmt: skip
    if abs(about["drift"]) > max(_DRIFTS, _LATE / max(float(np.ptp(device)), _LATE)):
        about["error_ms"] = None
        about["notes"] = [
            *about["notes"],
            "the read-out board's clock jumped in this run: signals may be tens of ms off; record"
            " it again",
        ]
    return at, about


def _by_leds(
    recording: Recording, part: slice, cameras: Sequence[CameraRecording], start: int,
    shift: Sequence[float], arrival: Clocks,
) -> tuple[Sync | None, list[str]]:  # fmt: skip
    """By the camera whose pictures of the LED tell most, and why others do not."""
    device, host = recording.device_us[part] / 1e6, (recording.host_ns[part] - start) / 1e9
    best: Sync | None = None
    why: list[str] = []
    for k, camera in enumerate(cameras):
        time = (camera.time - start) / 1e9 + shift[k]
        near = _near(time, host)
        if np.isfinite(camera.led[near]).sum() < 30:
            continue
        try:
            found = synchronize_by_led(
                time[near], camera.led[near], None, device, recording.led[part].astype(bool),
                arrival, conversion=_conversion(recording), max_gap=None,
            )  # fmt: skip
        except CaptureError as error:
            why.append(str(error))
            continue
        if best is None or found.error < best.error:
            best = found
    return best, why


def _near(time: Float, host: Float) -> Bool:
    """Frames (t,) while samples arrived, or nearly."""
    return np.asarray((time >= host[0] - _BESIDE) & (time <= host[-1] + _BESIDE))


def _conversion(recording: Recording) -> float:
    """s that the conversions of a sample take, as the read-out board said of itself."""
    for _, e in recording.events:
        if {"converter", "channels", "averages"} <= set(e):
            return conversion_time(int(e["converter"]), int(e["channels"]), int(e["averages"]))
    return 0.0


def told_of(sync: Sync, notes: Sequence[str]) -> dict[str, Any]:
    """A comparison of clocks, for `quality.json`."""
    return {
        "method": sync.method, "offset": sync.offset, "drift": sync.drift,
        "error_ms": 1e3 * sync.error, "evidence": sync.evidence, "notes": list(notes),
    }  # fmt: skip


def motion(tracks: Tracks) -> Float:
    """Distances (t, d) between markers that are seen often, those that change most: they do not
    change as the whole moves."""
    share = tracks.visible.mean(axis=0)
    often = np.argsort(-share)[:8]
    often = often[share[often] > 0.5]
    if len(often) < 2:
        raise CaptureError("too few markers are seen often enough to tell how the device moves")
    a, b = np.triu_indices(len(often), 1)
    apart = np.stack(
        [
            np.linalg.norm(tracks.points[:, i] - tracks.points[:, j], axis=1)
            for i, j in zip(often[a], often[b], strict=True)
        ],
        axis=1,
    )
    most = np.argsort(-np.nanstd(apart, axis=0))[:_DISTANCES]
    return np.asarray(apart[:, most])


def resistances_at(when: Float, time: Float, ohm: Float) -> Float:
    """Resistances (n, c) of samples at times (n,) s at other times (t,) s: linear in between, NaN
    outside and where more than four samples are lost. Samples of no later time than the one before
    are left out."""
    later = np.append(True, np.diff(time) > 0)
    time, ohm = time[later], ohm[later]
    return interpolate_at(when, time, ohm, max_gap=5 * float(np.median(np.diff(time))))
