"""A twin's session before rendered cameras: recorded as 'defsense capture record' leaves it, as
fast as pictures are rendered, and processed by the same code as any other."""

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
from ...capture.sessions.result_files import QUALITY
from ...capture.sessions.session import BOARD, CAMERAS, create, load, LOG, Log
from ...capture.tags.tag_patterns import dictionary
from ...capture.videos.detector_compilation import compile_detector
from ...core.camera import Camera
from ...core.device.device import Device
from ...core.mesh import TetMesh
from ...core.progress import Progress
from ...core.storage.files import storage_errors, write_json
from .processing import process_session
from ...twin.devices.camera_places import place_cameras, place_led
from ...twin.devices.twin_traits import FilmTraits
from ...twin.filming.camera_kinds import (
    CAMERA_KINDS,
    CameraKind,
    print_patch,
    simulate_passing_finger,
)
from ...twin.filming.cameras import RenderedCamera
from ...twin.scenes.device_motion import draw_sway
from ...twin.scenes.device_twin import DeviceTwin
from ...twin.scenes.scene import Backdrop, Led, Patch, Scene
from ...twin.recordings.run_files import (
    is_led_on,
    RUN_1,
    TRUTH,
    list_steps,
    write_samples,
    write_log,
    write_truth,
)
from ...twin.recordings.twin_recordings import TwinRun, TwinRuns

_LOOK = 0.5  # s between looks at how far the cameras are
_LATEST = 0.2  # of a picture's time, that its stamp is late at most, so that stamps stay in order


def film_session(
    folder: Path, device: Device, made: TwinRuns, number: int, film: FilmTraits, progress: Progress
) -> None:
    """The run of a `number` into an empty `folder`; nothing is processed yet. Raises CaptureError,
    StorageError."""
    run, seed = made.runs[number], [int(made.dataset.provenance["seed"]), number, 7]
    rng = np.random.default_rng(seed)
    kind, scenes = CAMERA_KINDS[film.kind], _Scenes(made, run, film, rng)
    cameras = place_cameras(scenes.twin.rest, made.markers, film.count)
    scenes.led_at = place_led(cameras[0], scenes.twin.rest)
    write_rig(folder / CAMERAS, [_calibrated(c, film, rng) for c in cameras], {"twin": True})
    create(
        folder, device=device.name, steps=list_steps(run), channels=made.dataset.channels,
        reference=made.converter.reference.tolist(), calibration=folder / CAMERAS,
        markers=made.markers, unit=run.recording.unit, layout=made.dataset.layout,
    )  # fmt: skip
    session = load(folder)
    with storage_errors(folder):
        (folder / RUN_1).mkdir()
    write_samples(folder / RUN_1 / BOARD, made, run, device.converter, LED_PERIOD_MS)
    tags = dictionary(session.markers.dictionary)
    compile_detector(session.rig.cameras[0], tags, lambda text: progress("filming", 0.0, text))
    lasts = float(run.walk.times[-1])
    phases = rng.random(film.count) if kind.free_running else np.zeros(film.count)
    sources = [
        RenderedCamera(
            camera,
            scenes.at,
            kind.optics,
            np.random.default_rng([*seed, k]),
            _moments(lasts, film.rate, float(phases[k]), kind, [*seed, k, 1]),
        )
        for k, camera in enumerate(cameras)
    ]
    with ExitStack() as stack:
        log = Log(folder / RUN_1 / LOG)
        stack.callback(log.close)
        stack.enter_context(one_thread_per_call(film.count > 1))
        recorders = []
        for camera, source in zip(session.rig.cameras, sources, strict=True):
            opener = partial(_given, source)
            recorder = CameraRecorder(opener, camera, tags, folder / RUN_1, log)
            stack.callback(recorder.close)
            recorders.append(recorder)
            recorder.start()
        _wait(recorders, sources, max(int(lasts * film.rate), 1), progress)
    write_log(folder / RUN_1 / LOG, run)


def _given(source: RenderedCamera) -> RenderedCamera:
    return source


def _wait(
    recorders: list[CameraRecorder], sources: list[RenderedCamera], pictures: int,
    progress: Progress,
) -> None:  # fmt: skip
    """Until all pictures are taken. Raises what a camera raised."""
    while not all(s.finished.is_set() for s in sources):
        time.sleep(_LOOK)
        for recorder in recorders:
            if recorder.failure is not None:
                raise recorder.failure
        done = min(r.frames for r in recorders)
        progress("filming", min(done / pictures, 1.0), f"{done} of {pictures} pictures")


def process_filmed(
    folder: Path, made: TwinRuns, run: TwinRun, film: FilmTraits, progress: Progress
) -> None:
    """As 'defsense capture process' does, with what makes the session a twin's, and the truth at
    the pictures' times. Raises CaptureError."""
    result = process_session(folder, progress=progress)
    kind = CAMERA_KINDS[film.kind]
    late = kind.delay + kind.jitter / 2
    first = result.quality["runs"][0]["steps"][0][0]  # the session's clock at the walk's beginning
    at = result.tracks.time - first - late
    shown = made.fields.displacements(made.markers.centers)
    moved = made.fields.space(run.walk(at)) @ shown.reshape(len(shown), -1)
    points = made.markers.centers + moved.reshape(len(at), -1, 3)
    truth = replace(run.truth, time=at, points=points)
    write_truth(folder / TRUTH, made.dataset.channels, made, truth, -first - late)
    quality = json.loads((folder / QUALITY).read_text(encoding="utf-8"))
    write_json(folder / QUALITY, {**quality, "twin": dict(made.dataset.provenance)})


class _Scenes:
    """What there is to be seen at a time."""

    def __init__(
        self, made: TwinRuns, run: TwinRun, film: FilmTraits, rng: np.random.Generator
    ) -> None:
        kind, markers, fields = CAMERA_KINDS[film.kind], made.markers, made.fields
        family = dictionary(markers.dictionary)
        seats = tuple(
            print_patch(
                Patch(int(n), family.pattern(int(n)), c, a, markers.size), kind.ink, kind.curl
            )
            for n, c, a in zip(markers.ids, markers.centers, markers.axes, strict=True)
        )  # fmt: skip
        corners = fields.mesh.cells[:, :4]
        tets = TetMesh(fields.mesh.nodes[: corners.max() + 1], corners)
        skin, nodes = tets.boundary().compact()
        self.twin = DeviceTwin(skin, fields.fields[:, nodes], seats)
        self.led_at = np.zeros(3)
        self._made, self._run = made, run
        bounds = skin.bounds
        self._hand = draw_sway(rng, bounds.mean(axis=0), shift=film.steady, degrees=film.steady)
        self._around = Scene(backdrop=Backdrop(), gloss=kind.gloss)
        towards = np.mean(
            [c.center for c in place_cameras(skin, markers, film.count)], axis=0
        ) - bounds.mean(axis=0)
        way = towards / np.linalg.norm(towards)
        self._passing = simulate_passing_finger(rng, bounds, way) if kind.passing else None

    def at(self, seconds: float) -> Scene:
        states = self._made.fields.space(self._run.walk(np.array([seconds])))[0]
        found = self.twin.scene(states, self._hand.pose_at(seconds), self._around)
        if self._passing is not None:
            found = found.replace(occluders=self._passing(seconds))
        return found.replace(led=Led(self.led_at, is_led_on(self._made, seconds, LED_PERIOD_MS), radius=3.0))


def _moments(
    lasts: float, rate: float, phase: float, kind: CameraKind, seed: list[int]
) -> Iterator[tuple[float, int]]:
    """Times, s, of a camera's pictures, and their stamps, ns."""
    rng = np.random.default_rng(seed)
    for k in range(int(lasts * rate - phase)):
        at = (k + phase) / rate
        late = kind.delay + min(kind.jitter * rng.random(), _LATEST / rate)
        yield at, round(1e9 * (at + late))


def _calibrated(camera: Camera, film: FilmTraits, rng: np.random.Generator) -> Camera:
    """As a calibration finds it."""
    K = camera.matrix.copy()
    K[0, 0] *= 1 + film.focal * rng.normal()
    K[1, 1] *= K[0, 0] / camera.matrix[0, 0]
    K[:2, 2] += film.center * rng.normal(size=2)
    turn = Rotation.from_rotvec(np.radians(film.turn) * rng.normal(size=3)).as_matrix()
    R = turn @ camera.rotation
    # A principal point that is off is made up for by where the camera is taken to look.
    aside = (K[:2, 2] - camera.matrix[:2, 2]) / np.diag(K)[:2]
    R = Rotation.from_rotvec([aside[1], -aside[0], 0]).as_matrix() @ R
    center = camera.center + film.shift * rng.normal(size=3)
    return replace(camera, matrix=K, rotation=R, translation=-R @ center)
