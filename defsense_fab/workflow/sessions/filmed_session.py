"""Sessions of a twin before rendered cameras, recorded and processed like real sessions."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ...capture.cameras.image_sources import one_thread_per_call
from ...capture.cameras.rig_file import write_rig
from ...capture.clocks.led_schedule import LED_PERIOD_MS
from ...capture.sessions.camera_recorder import CameraRecorder
from ...capture.sessions.results import QUALITY
from ...capture.sessions.session import BOARD, CAMERAS, LOG, Log, create, load
from ...capture.tags.tag_patterns import dictionary
from ...capture.videos.video_detection import compile_detector
from ...core.camera import Camera
from ...core.device.device import Device
from ...core.mesh import TetMesh
from ...core.progress import Progress
from ...core.storage.files import storage_errors, write_json
from ...twin.devices.camera_places import place_cameras, place_led
from ...twin.devices.twin_traits import FilmTraits
from ...twin.filming.camera_kinds import (
    CAMERA_KINDS,
    CameraKind,
    print_patch,
    simulate_passing_finger,
)
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
from ...twin.scenes.device_motion import draw_sway
from ...twin.scenes.device_twin import DeviceTwin
from ...twin.scenes.scene import Backdrop, Led, Patch, Scene
from .processing import process_session

POLL_S = 0.5  # between checks of the cameras' progress
MAX_JITTER = 0.2  # of the time between frames, so that time stamps stay in order
FILM_SEED = 7  # combined with the seed and the number of the session
LED_RADIUS_MM = 3.0


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
    kind, scenes = CAMERA_KINDS[film.kind], _FilmedScenes(runs, run, film, rng)
    cameras = place_cameras(scenes.twin.rest, runs.markers, film.count)
    scenes.led_position = place_led(cameras[0], scenes.twin.rest)
    write_rig(folder / CAMERAS, [_calibrate(c, film, rng) for c in cameras], {"twin": True})
    create(
        folder,
        device=device.name,
        steps=list_steps(run),
        channels=runs.dataset.channels,
        reference=runs.converter.reference.tolist(),
        calibration=folder / CAMERAS,
        markers=runs.markers,
        unit=run.recording.unit,
        layout=runs.dataset.layout,
    )
    session = load(folder)
    with storage_errors(folder):
        (folder / RUN_1).mkdir()
    write_samples(folder / RUN_1 / BOARD, runs, run, device.converter, LED_PERIOD_MS)
    tags = dictionary(session.markers.dictionary)
    compile_detector(session.rig.cameras[0], tags, lambda text: progress("filming", 0.0, text))
    duration = float(run.walk.times[-1])
    phases = rng.random(film.count) if kind.free_running else np.zeros(film.count)
    sources = [
        RenderedCamera(
            camera,
            scenes.scene_at,
            kind.optics,
            np.random.default_rng([*seed, k]),
            _frame_times(duration, film.rate, float(phases[k]), kind, [*seed, k, 1]),
        )
        for k, camera in enumerate(cameras)
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


class _FilmedScenes:
    """The scenes of a session by time.

    Attributes:
        twin: The moving device.
        led_position: Position of the LED (3,) mm; set before the first scene.
    """

    def __init__(
        self, runs: TwinRuns, run: TwinRun, film: FilmTraits, rng: np.random.Generator
    ) -> None:
        kind, markers, fields = CAMERA_KINDS[film.kind], runs.markers, runs.fields
        family = dictionary(markers.dictionary)
        tags = [
            Patch(int(n), family.pattern(int(n)), center, axes, markers.size)
            for n, center, axes in zip(markers.ids, markers.centers, markers.axes, strict=True)
        ]
        corners = fields.mesh.cells[:, :4]
        tets = TetMesh(fields.mesh.nodes[: corners.max() + 1], corners)
        skin, nodes = tets.boundary().compact()
        patches = tuple(print_patch(tag, kind.ink, kind.curl) for tag in tags)
        self.twin = DeviceTwin(skin, fields.fields[:, nodes], patches)
        self.led_position = np.zeros(3)
        self._runs, self._run = runs, run
        bounds = skin.bounds
        middle = bounds.mean(axis=0)
        self._sway = draw_sway(rng, middle, shift=film.steady, degrees=film.steady)
        self._surroundings = Scene(backdrop=Backdrop(), gloss=kind.gloss)
        eyes = [c.center for c in place_cameras(skin, markers, film.count)]
        towards = np.mean(eyes, axis=0) - middle
        direction = towards / np.linalg.norm(towards)
        self._finger_at = simulate_passing_finger(rng, bounds, direction) if kind.passing else None

    def scene_at(self, seconds: float) -> Scene:
        """Return the scene at a time, s."""
        weights = self._runs.fields.space(self._run.walk(np.array([seconds])))[0]
        scene = self.twin.scene(weights, self._sway.pose_at(seconds), self._surroundings)
        if self._finger_at is not None:
            scene = scene.replace(occluders=self._finger_at(seconds))
        is_on = is_led_on(self._runs, seconds, LED_PERIOD_MS)
        return scene.replace(led=Led(self.led_position, is_on, radius=LED_RADIUS_MM))


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
