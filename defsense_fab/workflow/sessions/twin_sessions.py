"""Simulated sessions as files: those of a processed session, the truth, and the assumptions.

Sessions before rendered cameras are recorded and processed like real sessions; others are written
as if they had been processed.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...capture.cameras.image_sources import one_thread_per_call
from ...capture.cameras.rig_file import write_rig
from ...capture.clocks.led_schedule import LED_PERIOD_MS
from ...capture.sessions.camera_recorder import CameraRecorder
from ...capture.sessions.results import QUALITY, ProcessedSession, quantiles, write_results
from ...capture.sessions.session import BOARD, CAMERAS, LOG, CaptureSession, Log, create, load
from ...capture.tags.tag_patterns import dictionary
from ...capture.videos.video_detection import compile_detector
from ...core.arrays import Float
from ...core.camera import Camera
from ...core.device.device import Device
from ...core.errors import CaptureError
from ...core.markers import Tracks
from ...core.mesh import TetMesh
from ...core.progress import Progress, silent
from ...core.storage.files import replace_folder, storage_errors, write_json, write_text
from ...report.session_page import lengths
from ...sensing.response import relative_change
from ...twin.devices.filmed_device import FilmedDevice
from ...twin.devices.twin_traits import FilmTraits
from ...twin.filming.camera_kinds import CAMERA_KINDS, CameraKind
from ...twin.filming.cameras import RenderedCamera
from ...twin.recordings.run_files import (
    RUN_1,
    TRUTH,
    is_led_on,
    list_steps,
    write_log,
    write_samples,
    write_truth,
)
from ...twin.recordings.twin_recordings import TwinRun, TwinRuns
from ...twin.scenes.scene import Scene
from .processing import process_session

ASSUMPTIONS = "assumptions.md"
POLL_S = 0.5  # between checks of the cameras' progress
MAX_JITTER = 0.2  # of the time between frames, so that time stamps stay in order
FILM_SEED = 7  # combined with the seed and the number of the session


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
    session = _create_session(folder, device, runs, run)
    write_samples(folder / RUN_1 / BOARD, runs, run, device.converter)
    write_log(folder / RUN_1 / LOG, run)
    write_results(folder, session, _processed(final, session, runs, run))
    write_truth(folder / TRUTH, session.channels, runs, run.truth)


def _create_session(
    folder: Path, device: Device, runs: TwinRuns, run: TwinRun, calibration: Path | None = None
) -> CaptureSession:
    """Create a session with an empty folder for its run."""
    create(
        folder,
        device=device.name,
        steps=list_steps(run),
        channels=runs.dataset.channels,
        reference=runs.converter.reference.tolist(),
        calibration=calibration,
        markers=runs.markers,
        unit=run.recording.unit,
        layout=runs.dataset.layout,
    )
    with storage_errors(folder):
        (folder / RUN_1).mkdir()
    return load(folder)


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
    visible = tracks.visible.mean(axis=0).tolist()
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
        "seen": dict(zip(map(str, tracks.ids.tolist()), visible, strict=True)),
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
        f"Unit {provenance['unit']}, seed {provenance['seed']}, {provenance['cords']} cords,"
        f" disabled traits: {off}. The option `off` disables all numbers of a"
        " trait. Numbers without a trait cannot be disabled.",
        "",
        f"Shapes are interpolated between {len(fields.space.states)} solved states. States that"
        f" are left out are predicted with an error of {fields.error:.3g} mm RMS at the markers"
        f" and {fields.signal_error:.2g} of (R - R0)/R0.",
        "",
        "| trait | number | value | unit | meaning | source |",
        "|---|---|---|---|---|---|",
    ]
    for a in runs.traits.assumptions:
        name = a.trait if a.trait in runs.traits.names else ""
        value = ", ".join(f"{v:g}" for v in a.value) if isinstance(a.value, tuple) else a.value
        cells = (name, a.name, str(value), a.unit, a.meaning, a.source)
        lines.append("| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |")
    return "\n".join(lines) + "\n"


def film_session(
    folder: Path, device: Device, runs: TwinRuns, number: int, film: FilmTraits, progress: Progress
) -> None:
    """Record a simulated session with rendered cameras; nothing is processed yet.

    Args:
        folder: An empty folder.
        device: The device.
        runs: The simulated sessions.
        number: Index of the session.
        film: The cameras.
        progress: Called with the progress.

    Raises:
        CaptureError: A camera fails.
        StorageError: Files cannot be written.
    """
    run, seed = runs.runs[number], [int(runs.dataset.provenance["seed"]), number, FILM_SEED]
    rng = np.random.default_rng(seed)
    kind, (filmed, scene_at) = CAMERA_KINDS[film.kind], _set_up_scenes(runs, run, film, rng)
    calibrated = [_calibrate(c, film, rng) for c in filmed.cameras]
    write_rig(folder / CAMERAS, calibrated, {"twin": True})
    session = _create_session(folder, device, runs, run, folder / CAMERAS)
    write_samples(folder / RUN_1 / BOARD, runs, run, device.converter, LED_PERIOD_MS)
    tags = dictionary(session.markers.dictionary)
    compile_detector(session.rig.cameras[0], tags, lambda text: progress("filming", 0.0, text))
    duration = float(run.walk.times[-1])
    phases = rng.random(film.count) if kind.free_running else np.zeros(film.count)
    sources = [
        RenderedCamera(
            camera,
            scene_at,
            kind.optics,
            np.random.default_rng([*seed, k]),
            _frame_times(duration, film.rate, float(phases[k]), kind, [*seed, k, 1]),
        )
        for k, camera in enumerate(filmed.cameras)
    ]
    with ExitStack() as stack:
        log = Log(folder / RUN_1 / LOG)
        stack.callback(log.close)
        stack.enter_context(one_thread_per_call(film.count > 1))
        recorders = []
        for camera, source in zip(session.rig.cameras, sources, strict=True):
            opener = partial(_identity, source)
            recorder = CameraRecorder(opener, camera, tags, folder / RUN_1, log)
            stack.callback(recorder.close)
            recorders.append(recorder)
            recorder.start()
        _wait(recorders, sources, max(int(duration * film.rate), 1), progress)
    write_log(folder / RUN_1 / LOG, run)


def _identity(source: RenderedCamera) -> RenderedCamera:
    return source


def _wait(
    recorders: list[CameraRecorder],
    sources: list[RenderedCamera],
    frames: int,
    progress: Progress,
) -> None:
    """Wait until all frames are taken; raise the error of a camera that fails."""
    while not all(s.finished.is_set() for s in sources):
        time.sleep(POLL_S)
        for recorder in recorders:
            if recorder.failure is not None:
                raise recorder.failure
        done = min(r.frames for r in recorders)
        progress("filming", min(done / frames, 1.0), f"{done} of {frames} frames")


def process_filmed(
    folder: Path, runs: TwinRuns, run: TwinRun, film: FilmTraits, progress: Progress
) -> None:
    """Process a filmed session, and write the truth at the times of its frames.

    Args:
        folder: Folder of the session.
        runs: The simulated sessions.
        run: The session.
        film: The cameras.
        progress: Called with the progress.

    Raises:
        CaptureError: The session cannot be processed.
    """
    result = process_session(folder, progress=progress)
    kind = CAMERA_KINDS[film.kind]
    delay = kind.delay + kind.jitter / 2
    start = result.quality["runs"][0]["steps"][0][0]  # of the walk, by the session's clock
    time = result.tracks.time - start - delay
    shown = runs.fields.displacements(runs.markers.centers)
    moved = runs.fields.space(run.walk(time)) @ shown.reshape(len(shown), -1)
    points = runs.markers.centers + moved.reshape(len(time), -1, 3)
    truth = replace(run.truth, time=time, points=points)
    write_truth(folder / TRUTH, runs.dataset.channels, runs, truth, -start - delay)
    quality = json.loads((folder / QUALITY).read_text(encoding="utf-8"))
    write_json(folder / QUALITY, {**quality, "twin": dict(runs.dataset.provenance)})


def _set_up_scenes(
    runs: TwinRuns, run: TwinRun, film: FilmTraits, rng: np.random.Generator
) -> tuple[FilmedDevice, Callable[[float], Scene]]:
    """Return the device before its cameras, and a function of its scene at a time, s."""
    fields = runs.fields
    corners = fields.mesh.cells[:, :4]
    tets = TetMesh(fields.mesh.nodes[: corners.max() + 1], corners)
    skin, nodes = tets.boundary().compact()
    skin_fields, kind = fields.fields[:, nodes], CAMERA_KINDS[film.kind]
    filmed = FilmedDevice(skin, skin_fields, runs.markers, kind, film.count, film.steady, rng)

    def scene_at(seconds: float) -> Scene:
        weights = fields.space(run.walk(np.array([seconds])))[0]
        return filmed.scene(weights, seconds, is_led_on=is_led_on(runs, seconds, LED_PERIOD_MS))

    return filmed, scene_at


def _frame_times(
    duration: float, rate: float, phase: float, kind: CameraKind, seed: list[int]
) -> Iterator[tuple[float, int]]:
    """Yield the times of a camera's frames, s, and their time stamps, ns."""
    rng = np.random.default_rng(seed)
    for k in range(int(duration * rate - phase)):
        seconds = (k + phase) / rate
        delay = kind.delay + min(kind.jitter * rng.random(), MAX_JITTER / rate)
        yield seconds, round(1e9 * (seconds + delay))


def _calibrate(camera: Camera, film: FilmTraits, rng: np.random.Generator) -> Camera:
    """Return a camera with the errors of its calibration."""
    K = camera.matrix.copy()
    K[0, 0] *= 1 + film.focal * rng.normal()
    K[1, 1] *= K[0, 0] / camera.matrix[0, 0]
    K[:2, 2] += film.center * rng.normal(size=2)
    turn = Rotation.from_rotvec(np.radians(film.turn) * rng.normal(size=3)).as_matrix()
    R = turn @ camera.rotation
    # The calibrated orientation makes up for the error of the principal point.
    aside = (K[:2, 2] - camera.matrix[:2, 2]) / np.diag(K)[:2]
    R = Rotation.from_rotvec([aside[1], -aside[0], 0]).as_matrix() @ R
    center = camera.center + film.shift * rng.normal(size=3)
    return replace(camera, matrix=K, rotation=R, translation=-R @ center)
