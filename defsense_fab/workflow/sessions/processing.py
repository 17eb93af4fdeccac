"""Process a recorded session: tracks in the rest frame, with the signals at the same times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...capture.files.formats import write_tracks
from ...capture.files.track_conversion import FrameGrid, frame_grid
from ...capture.sessions.rest_frame import RestAlignment, align_with_rest
from ...capture.sessions.results import REPORT as REPORT
from ...capture.sessions.results import TRACKS, ClockPart, quantiles, write_results
from ...capture.sessions.results import ProcessedSession as ProcessedSession
from ...capture.sessions.session import CaptureSession, load, run_ending
from ...capture.sessions.signals import rest_resistances
from ...core.arrays import Float, Int
from ...core.errors import CaptureError
from ...core.markers import Tracks
from ...core.progress import Progress, silent
from ...core.version import __version__
from ...report.session_page import lengths, write_report
from ...sensing.response import relative_change
from .options import ProcessOptions
from .session_runs import ProcessedRun, process_captured_run, process_run

PAUSE_S = 1.0  # between runs, in the tracks' time
DEFAULT_OPTIONS = ProcessOptions()


def process_session(
    folder: Path, options: ProcessOptions = DEFAULT_OPTIONS, progress: Progress = silent
) -> ProcessedSession:
    """Process all runs of a session and write the results into its folder.

    Args:
        folder: Folder of the session.
        options: How it is aligned to rest, and where its markers come from.
        progress: Called with the progress.

    Raises:
        CaptureError: Nothing was recorded (`session-empty`), no run can be used
            (`session-unusable`), or tracks of another system are given for several runs
            (`tracks-for-several-runs`).
        StorageError: A file cannot be written.
    """
    session = load(folder)
    if options.tracks is not None and len(session.runs) != 1:
        raise CaptureError(
            f"has {len(session.runs)} runs, but a file of tracks belongs to one run",
            code="tracks-for-several-runs",
            where=folder,
            action="Record each take in a session of its own",
            runs=len(session.runs),
        )
    if not session.runs:
        raise CaptureError(
            "nothing was recorded yet",
            code="session-empty",
            where=folder,
            action="Run 'defsense capture record'",
        )
    runs: list[ProcessedRun] = []
    skipped = []
    for k, run in enumerate(session.runs):
        progress("session", 0.9 * k / len(session.runs), f"reading {run.name}")
        try:
            if options.tracks is None:
                runs.append(
                    process_run(session, run, from_video=options.from_video, progress=progress)
                )
            else:
                runs.append(process_captured_run(session, run, options.tracks, options.tracks_unit))
        except CaptureError as error:
            skipped.append(
                {
                    "run": run.name,
                    "why": str(error),
                    "code": error.code,
                    "ended": run_ending(run),
                }
            )
    if not runs:
        reasons = "; ".join(f"{s['run']}: {s['why']}" for s in skipped)
        raise CaptureError(
            f"no run can be used: {reasons}",
            code="session-unusable",
            where=folder,
            codes=[s["code"] for s in skipped],
        )
    progress("session", 0.9, "aligning the tracks to rest")
    result = _join(session, runs, skipped, options.align)
    progress("session", 0.95, "writing tracks, signals and the report")
    write_tracks(folder / TRACKS, result.tracks)
    write_results(folder, session, result)
    write_report(folder / REPORT, session, result)
    progress("session", 1.0, "done")
    return result


@dataclass(frozen=True)
class _Timeline:
    """The runs one after the other, with pauses between them.

    Attributes:
        time: Times of all frames (t,), s.
        grid: Grid of the times; None for a single frame.
        rates: Rates of the runs whose frames are even, Hz.
        dropped: Number of frames that the cameras dropped.
        clocks: By run: relations of the board's clock to the times.
        spans: By run: first and last time, and the start of each step.
    """

    time: Float
    grid: FrameGrid | None
    rates: list[float]
    dropped: int
    clocks: dict[str, list[ClockPart]]
    spans: list[dict[str, Any]]

    @property
    def is_even(self) -> bool:
        """Whether all frames have one rate."""
        return self.grid is not None and self.grid.is_even

    @property
    def frame_numbers(self) -> Int:
        """Numbers of the frames (t,); files of tracks count dropped frames too."""
        if self.grid is not None and self.grid.is_even:
            return self.grid.index
        return np.arange(len(self.time))

    @property
    def rate(self) -> float | None:
        """Frames per second, Hz; None if the times are uneven."""
        return 1 / self.grid.period if self.grid is not None and self.grid.is_even else None


def _line_up(runs: Sequence[ProcessedRun]) -> _Timeline:
    times: list[Float] = []
    clocks: dict[str, list[ClockPart]] = {}
    rates: list[float] = []
    spans: list[dict[str, Any]] = []
    start, dropped = 0.0, 0
    for run in runs:
        time = run.video.tracks.time
        grid = frame_grid(time)
        if grid is not None and grid.is_even:
            dropped += grid.gaps
            rates.append(1 / grid.period)
        shift = start - float(time[0])
        shifted = time + start - time[0]
        times.append(shifted)
        clocks[str(run.record["run"])] = [part.shifted(shift) for part in run.clocks]
        steps = [[step_start + shift, name] for step_start, name in run.steps]
        spans.append({"begin": float(shifted[0]), "end": float(shifted[-1]), "steps": steps})
        pause = PAUSE_S if grid is None else max(round(PAUSE_S / grid.period), 1) * grid.period
        start = float(shifted[-1]) + pause
    time = np.concatenate(times)
    return _Timeline(time, frame_grid(time), rates, dropped, clocks, spans)


def _join(
    session: CaptureSession, runs: list[ProcessedRun], skipped: list[dict[str, Any]], anchor: str
) -> ProcessedSession:
    """Join runs in the rest frame; their tracks are removed from `runs` to save memory."""
    ids = session.markers.ids
    timeline = _line_up(runs)
    corners = _join_corners(runs, ids[session.markers.anchor])
    points, sigma = _join_positions(runs, ids)
    number = timeline.frame_numbers
    tracks = Tracks(timeline.time, ids, points, sigma, number)
    is_resting = np.concatenate([r.is_resting for r in runs])
    alignment = align_with_rest(session.markers, tracks, corners, is_resting, anchor)
    names, ohm = [str(r.record["run"]) for r in runs], [r.ohm for r in runs]
    R0, warnings = rest_resistances(names, session.channels, ohm, [r.is_resting for r in runs])
    warnings = [*alignment.warnings, *warnings, *_timeline_warnings(timeline, runs)]
    if not is_resting.any():
        warnings.append("no rest was finished: R0 and the rest pose are those of the whole session")
    aligned = alignment.aligned
    rest_tracks = Tracks(timeline.time, ids, aligned.points, aligned.sigma, number)
    with np.errstate(all="ignore"):
        quality = {
            **_session_quality(session, runs, timeline, skipped),
            **_alignment_quality(alignment, rest_tracks),
            "warnings": warnings,
            "R0": {
                name: [float(r) if np.isfinite(r) else None for r in values]
                for name, values in zip(names, R0, strict=True)
            },
        }
        signals = [relative_change(R, rest) for R, rest in zip(ohm, R0, strict=True)]
    return ProcessedSession(
        tracks,
        rest_tracks,
        np.concatenate(signals),
        np.concatenate(ohm),
        aligned.residual,
        quality,
        timeline.clocks,
    )


def _timeline_warnings(timeline: _Timeline, runs: Sequence[ProcessedRun]) -> list[str]:
    if timeline.is_even or not len(timeline.rates) == len(runs) > 1:
        return []
    rates = ", ".join(f"{rate:.4g}" for rate in timeline.rates)
    return [
        f"the runs' cameras had different rates ({rates} Hz): the files' times are uneven, and"
        " frames that were dropped are not filled in"
    ]


def _session_quality(
    session: CaptureSession,
    runs: Sequence[ProcessedRun],
    timeline: _Timeline,
    skipped: list[dict[str, Any]],
) -> dict[str, Any]:
    time = timeline.time
    return {
        "session": str(session.folder),
        "device": session.device,
        "version": __version__,
        "unit": session.unit,
        "layout": session.layout,
        "runs": [
            run.record | span | {"sync": run.sync, "tracks": run.video.quality}
            for run, span in zip(runs, timeline.spans, strict=True)
        ],
        "skipped": skipped,
        "frames": len(time),
        "seconds": float(time[-1] - time[0]),
        "rate": timeline.rate,
        "dropped": timeline.dropped,
    }


def _alignment_quality(alignment: RestAlignment, tracks: Tracks) -> dict[str, Any]:
    aligned = alignment.aligned
    visible = tracks.visible.mean(axis=0).tolist()
    return {
        "aligned_by": alignment.by,
        "aligned_frames": float(aligned.ok.mean()),
        "by_all": alignment.by_all,
        "by_all_off": alignment.off,
        "residual": quantiles(aligned.residual),
        "sigma": quantiles(lengths(tracks.sigma)[tracks.visible]),
        "seen": dict(zip(map(str, tracks.ids.tolist()), visible, strict=True)),
        "glued": alignment.glued,
    }


def _join_corners(runs: Sequence[ProcessedRun], ids: Int) -> NDArray[np.float32]:
    """Return the corners of tags (a,) in all runs (t, a, 4, 3), mm."""
    if len(runs) == 1 and np.array_equal(runs[0].video.outlined, ids):
        return runs[0].video.corners
    corners = np.full((sum(len(r.ohm) for r in runs), len(ids), 4, 3), np.nan, np.float32)
    end = 0
    for run in runs:
        rows, end = slice(end, end + len(run.ohm)), end + len(run.ohm)
        for k, number in enumerate(run.video.outlined):
            corners[rows, ids.tolist().index(int(number))] = run.video.corners[:, k]
    return corners


def _join_positions(runs: list[ProcessedRun], ids: Int) -> tuple[Float, Float]:
    """Return positions and standard deviations (t, m, 3), mm, of tags (m,) in all runs.

    The runs' own tracks are replaced by empty ones: each would be in memory twice.
    """
    if len(runs) == 1 and np.array_equal(runs[0].video.tracks.ids, ids):
        tracks = runs[0].video.tracks
        return tracks.points, tracks.sigma
    shape = (sum(len(r.ohm) for r in runs), len(ids), 3)
    points, sigma = np.full(shape, np.nan), np.full(shape, np.nan)
    end = 0
    for n, run in enumerate(runs):
        tracks = run.video.tracks
        rows, end = slice(end, end + len(tracks.time)), end + len(tracks.time)
        _, columns, own_columns = np.intersect1d(ids, tracks.ids, return_indices=True)
        points[rows, columns] = tracks.points[:, own_columns]
        sigma[rows, columns] = tracks.sigma[:, own_columns]
        none = np.zeros((0, len(tracks.ids), 3))
        empty = Tracks(np.zeros(0), tracks.ids, none, none, np.zeros(0, np.int64))
        runs[n] = replace(run, video=replace(run.video, tracks=empty))
    return points, sigma
