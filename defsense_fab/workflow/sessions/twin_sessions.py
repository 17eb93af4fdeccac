"""Simulated sessions as files: those of a processed session, the truth, and the assumptions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...capture.sessions.results import ProcessedSession, quantiles, write_results
from ...capture.sessions.session import BOARD, LOG, CaptureSession, create, load
from ...core.arrays import Float
from ...core.device.device import Device
from ...core.errors import CaptureError
from ...core.markers import Tracks
from ...core.progress import Progress, silent
from ...core.storage.files import replace_folder, storage_errors, write_text
from ...report.session_page import lengths
from ...sensing.response import relative_change
from ...twin.recordings.run_files import (
    RUN_1,
    TRUTH,
    list_steps,
    write_log,
    write_samples,
    write_truth,
)
from ...twin.recordings.twin_recordings import TwinRun, TwinRuns
from .filmed_session import film_session, process_filmed

ASSUMPTIONS = "assumptions.md"


def write_sessions(
    out: Path, device: Device, runs: TwinRuns, progress: Progress = silent
) -> list[Path]:
    """Write simulated sessions.

    If the assumptions contain a film, markers are where rendered cameras see them.

    Args:
        out: Folder of the session; of several sessions, the parent of `session-1`, `session-2`, ...
        device: The device.
        runs: The simulated sessions.
        progress: Called with the progress.

    Returns:
        The folders of the sessions.

    Raises:
        CaptureError: A rendered session cannot be recorded or processed.
        StorageError: Files cannot be written.
    """
    film, count = runs.traits.film, len(runs.runs)
    folders = [out / f"session-{k + 1}" if count > 1 else out for k in range(count)]
    for k, (folder, run) in enumerate(zip(folders, runs.runs, strict=True)):
        progress("writing", k / len(folders), str(folder))
        with replace_folder(folder) as temporary:
            if film is None:
                _write_session(temporary, folder, device, runs, run)
            else:
                film_session(temporary, device, runs, k, film, progress)
            write_text(temporary / ASSUMPTIONS, format_assumptions(runs))
        if film is not None:
            process_filmed(folder, runs, run, film, progress)
    progress("writing", 1.0, "done")
    return folders


def session_folder(device: Device, unit: int, seed: int) -> Path:
    """Return the default folder of a simulated session."""
    return device.source / f"twin-{unit}-{seed}"


def check_free(out: Path, sessions: int) -> None:
    """Check that sessions would not be written over existing files.

    Raises:
        CaptureError: A folder is not empty (`folder-not-empty`).
    """
    for folder in [out, *(out / f"session-{k + 1}" for k in range(sessions) if sessions > 1)]:
        if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
            raise CaptureError(
                "exists already and is not empty",
                code="folder-not-empty",
                where=folder,
                action="Choose another folder",
            )


def _write_session(folder: Path, final: Path, device: Device, runs: TwinRuns, run: TwinRun) -> None:
    """Write a session to an empty `folder`, which is moved to `final` afterwards."""
    create(
        folder,
        device=device.name,
        steps=list_steps(run),
        channels=runs.dataset.channels,
        reference=runs.converter.reference.tolist(),
        calibration=None,
        markers=runs.markers,
        unit=run.recording.unit,
        layout=runs.dataset.layout,
    )
    session = load(folder)
    with storage_errors(folder):
        (folder / RUN_1).mkdir()
    write_samples(folder / RUN_1 / BOARD, runs, run, device.converter)
    write_log(folder / RUN_1 / LOG, run)
    write_results(folder, session, _processed(final, session, runs, run))
    write_truth(folder / TRUTH, session.channels, runs, run.truth)


def _processed(
    folder: Path, session: CaptureSession, runs: TwinRuns, run: TwinRun
) -> ProcessedSession:
    r = run.recording
    tracks = Tracks(r.time, runs.markers.ids, r.points, r.sigma, np.arange(len(r.time)))
    with np.errstate(all="ignore"):
        signals = relative_change(run.frame_ohm, r.rest)
    quality = _quality(folder, session, runs, run, tracks)
    residual = np.full(len(r.time), np.nan)
    clocks = {RUN_1: [run.clock]}
    return ProcessedSession(tracks, tracks, signals, run.frame_ohm, residual, quality, clocks)


def _quality(
    folder: Path, session: CaptureSession, runs: TwinRuns, run: TwinRun, tracks: Tracks
) -> dict[str, Any]:
    """Return the quality of a session before cameras, with the provenance of the twin."""
    sync = {
        "method": "twin",
        "offset": run.clock.offset,
        "drift": run.clock.drift,
        "error_ms": 1e3 * runs.traits.board.sync_error,
        "notes": [],
    }
    track_quality = {
        "warnings": [],
        "by_several": float(tracks.visible.mean()),
        "by_one": 0.0,
        "impossible": 0,
    }
    run_quality = {
        "run": RUN_1,
        "ended": "all steps were shown",
        "cut": 0,
        "sync": sync,
        "tracks": track_quality,
        "begin": float(tracks.time[0]),
        "end": float(tracks.time[-1]),
        "steps": [[float(start), name] for start, name in run.recording.poses],
    }
    seen = tracks.visible.mean(axis=0).tolist()
    return {
        "session": str(folder),
        "device": session.device,
        "runs": [run_quality],
        "skipped": [],
        "frames": len(tracks.time),
        "seconds": float(tracks.time[-1] - tracks.time[0]),
        "rate": runs.traits.markers.rate,
        "dropped": 0,
        "aligned_by": "twin",
        "aligned_frames": 1.0,
        "by_all": 0.0,
        "by_all_off": None,
        "residual": quantiles(np.empty(0)),
        "sigma": quantiles(lengths(tracks.sigma)[tracks.visible]),
        "seen": dict(zip(map(str, tracks.ids.tolist()), seen, strict=True)),
        "glued": [],
        "warnings": list(runs.fields.warnings),
        "R0": {RUN_1: _finite_or_none(run.recording.rest)},
        "layout": runs.dataset.layout,
        "unit": run.recording.unit,
        "twin": dict(runs.dataset.provenance),
    }


def _finite_or_none(values: Float) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in values]


def format_assumptions(runs: TwinRuns) -> str:
    """Return a page in Markdown with every assumed number and its source."""
    provenance, fields = runs.dataset.provenance, runs.fields
    off = ", ".join(provenance["off"]) or "none"
    lines = [
        f"# Assumptions of the twin of {runs.dataset.device}",
        "",
        f"Unit {provenance['unit']}, seed {provenance['seed']}, disabled traits: {off}. `--off"
        " NAME,NAME` disables all numbers of a trait. Numbers without a name in the first column"
        " cannot be disabled.",
        "",
        f"Shapes are interpolated between {len(fields.space.states)} solved states. States that"
        f" are left out are predicted with an error of {fields.error:.3g} mm RMS at the markers"
        f" and {fields.signal_error:.2g} of (R - R0)/R0.",
        "",
        "| --off | number | value | unit | meaning | source |",
        "|---|---|---|---|---|---|",
    ]
    for a in runs.traits.assumptions:
        name = a.trait if a.trait in runs.traits.names else ""
        value = ", ".join(f"{v:g}" for v in a.value) if isinstance(a.value, tuple) else a.value
        cells = (name, a.name, str(value), a.unit, a.meaning, a.source)
        lines.append("| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |")
    return "\n".join(lines) + "\n"
