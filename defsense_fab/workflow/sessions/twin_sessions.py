"""A twin's sessions as files: those that 'defsense capture process' leaves, with the truth beside
them and a page of what was taken for granted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...capture.sessions.processed_session import ProcessedSession
from ...capture.sessions.result_files import quantiles, write_results
from ...capture.sessions.session import BOARD, CaptureSession, create, load, LOG
from ...core.arrays import Float
from ...core.device.device import Device
from ...core.errors import CaptureError
from ...core.markers import Tracks
from ...core.progress import Progress, silent
from ...core.storage.files import replace_folder, storage_errors, write_text
from ...report.session_page import lengths
from ...sensing.response import relative_change
from .filmed_session import film_session, process_filmed
from ...twin.recordings.run_files import (
    RUN_1,
    TRUTH,
    list_steps,
    write_samples,
    write_log,
    write_truth,
)
from ...twin.recordings.twin_recordings import TwinRun, TwinRuns

ASSUMPTIONS = "assumptions.md"


def write_sessions(
    out: Path, device: Device, made: TwinRuns, progress: Progress = silent
) -> list[Path]:
    """Into `out`, or folders session-1, session-2, ... in it where there are several; the folders.
    Where the traits have a film, markers are where rendered cameras see them. Raises CaptureError,
    StorageError."""
    film = made.traits.film
    several = len(made.runs) > 1
    folders = [out / f"session-{k + 1}" if several else out for k in range(len(made.runs))]
    for k, (folder, run) in enumerate(zip(folders, made.runs, strict=True)):
        progress("writing", k / len(folders), str(folder))
        with replace_folder(folder) as temporary:
            if film is None:
                _write_session(temporary, folder, device, made, run)
            else:
                film_session(temporary, device, made, k, film, progress)
            write_text(temporary / ASSUMPTIONS, assumptions_page(made))
        if film is not None:
            process_filmed(folder, made, run, film, progress)
    progress("writing", 1.0, "done")
    return folders


def session_folder(device: Device, unit: int, seed: int) -> Path:
    """Where a twin's session goes that is not told where."""
    return device.source / f"twin-{unit}-{seed}"


def check_free(out: Path, sessions: int) -> None:
    """Raises CaptureError where sessions would be written over something."""
    for folder in [out, *(out / f"session-{k + 1}" for k in range(sessions) if sessions > 1)]:
        if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
            raise CaptureError(f"{folder}: is there already; choose another folder with --out")


def _write_session(folder: Path, final: Path, device: Device, made: TwinRuns, run: TwinRun) -> None:
    """Into an empty `folder`, that is to be at `final`."""
    create(
        folder, device=device.name, steps=list_steps(run), channels=made.dataset.channels,
        reference=made.converter.reference.tolist(), calibration=None, markers=made.markers,
        unit=run.recording.unit, layout=made.dataset.layout,
    )  # fmt: skip
    session = load(folder)
    with storage_errors(folder):
        (folder / RUN_1).mkdir()
    write_samples(folder / RUN_1 / BOARD, made, run, device.converter)
    write_log(folder / RUN_1 / LOG, run)
    write_results(folder, session, _processed(final, session, made, run))
    write_truth(folder / TRUTH, session.channels, made, run.truth)


def _processed(
    folder: Path, session: CaptureSession, made: TwinRuns, run: TwinRun
) -> ProcessedSession:
    r = run.recording
    tracks = Tracks(r.time, made.markers.ids, r.points, r.sigma, np.arange(len(r.time)))
    with np.errstate(all="ignore"):
        signals = relative_change(run.at, r.rest)
    quality = _quality(folder, session, made, run, tracks)
    residual = np.full(len(r.time), np.nan)
    clocks = {RUN_1: [run.clock]}
    return ProcessedSession(tracks, tracks, signals, run.at, residual, quality, clocks)


def _quality(
    folder: Path, session: CaptureSession, made: TwinRuns, run: TwinRun, tracks: Tracks
) -> dict[str, Any]:
    """As of a session before cameras, and what makes it a twin's."""
    b, told = made.traits.board, made.dataset.provenance
    sync = {
        "method": "twin", "offset": run.clock.offset, "drift": run.clock.drift,
        "error_ms": 1e3 * b.sync_error, "notes": [],
    }  # fmt: skip
    about = {
        "warnings": [], "by_several": float(tracks.seen.mean()), "by_one": 0.0, "impossible": 0,
    }  # fmt: skip
    ended = {
        "run": RUN_1, "ended": "all steps were shown", "cut": 0, "sync": sync, "tracks": about,
        "begin": float(tracks.time[0]), "end": float(tracks.time[-1]),
        "steps": [[float(at), name] for at, name in run.recording.poses],
    }  # fmt: skip
    seen = tracks.seen.mean(axis=0).tolist()
    return {
        "session": str(folder), "device": session.device, "runs": [ended], "skipped": [],
        "frames": len(tracks.time), "seconds": float(tracks.time[-1] - tracks.time[0]),
        "rate": made.traits.markers.rate, "dropped": 0, "aligned_by": "twin",
        "aligned_frames": 1.0, "by_all": 0.0, "by_all_off": None,
        "residual": quantiles(np.empty(0)),
        "sigma": quantiles(lengths(tracks.sigma)[tracks.seen]),
        "seen": dict(zip(map(str, tracks.ids.tolist()), seen, strict=True)), "glued": [],
        "warnings": list(made.fields.warnings), "R0": {RUN_1: _plain(run.recording.rest)},
        "layout": made.dataset.layout, "unit": run.recording.unit, "twin": dict(told),
    }  # fmt: skip


def _plain(values: Float) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in values]


def assumptions_page(made: TwinRuns) -> str:
    """Every number with its source, as Markdown."""
    told, f = made.dataset.provenance, made.fields
    off = ", ".join(told["off"]) or "nothing"
    lines = [
        f"# What the twin of {made.dataset.device} takes for granted", "",
        f"Unit {told['unit']}, seed {told['seed']}, switched off: {off}. `--off NAME,NAME` switches"
        " off all numbers of a trait; what cannot be switched off has no name in the first column.",
        "",
        f"Shapes are interpolated between {len(f.space.states)} solved states: states that are"
        f" left out are found within {f.error:.3g} mm RMS at the markers and {f.signal_error:.2g}"
        " of (R - R0)/R0.", "",
        "| --off | number | value | unit | meaning | source |", "|---|---|---|---|---|---|",
    ]  # fmt: skip
    for a in made.traits.told:
        name = a.trait if a.trait in made.traits.names else ""
        value = ", ".join(f"{v:g}" for v in a.value) if isinstance(a.value, tuple) else a.value
        cells = (name, a.name, str(value), a.unit, a.meaning, a.source)
        lines.append("| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |")
    return "\n".join(lines) + "\n"
