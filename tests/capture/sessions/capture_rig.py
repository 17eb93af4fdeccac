"""A plate with tags, two small cameras and a board, for tests of capture sessions.

As a program it records a session into a folder until it is killed.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from defsense_fab.capture.cameras.rig_file import write_rig
from defsense_fab.capture.readout.reader import Reader, ReadoutSettings
from defsense_fab.capture.readout.recording import Recorder
from defsense_fab.capture.readout.source import Event, StampedSample
from defsense_fab.capture.sessions import session as sessions
from defsense_fab.capture.sessions.guided_recording import GuidedRecording
from defsense_fab.capture.sessions.pose_coverage import BINS, PoseCoverage
from defsense_fab.capture.tags.detection import Detector
from defsense_fab.capture.tags.tag_patterns import dictionary
from defsense_fab.core.camera import Camera
from defsense_fab.core.errors import CaptureError
from defsense_fab.core.guided_run import GuidedView
from defsense_fab.core.markers import Markers
from defsense_fab.sensing.response import Response
from defsense_fab.sensing.serial_frames import Sample
from defsense_fab.sensing.voltage_divider import Dividers
from defsense_fab.twin.electronics.cords import CordTraits, DeviceCords
from defsense_fab.twin.electronics.readout_board import ReadoutTwin
from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.filming.renderer import Renderer
from defsense_fab.twin.scenes.scene import Patch, Scene

SIZE, SIDE, RATE = (360, 270), 15.0, 25.0
TRAITS = CordTraits(Response.line(1.0), noise=0.001, play=1e-4, healing=0.01)
CENTERS = np.array([[x, y, 0.0] for x in (-32.0, 0, 32) for y in (-20.0, 20)])
FACING = np.diag([1.0, -1, -1])


def cameras() -> tuple[Camera, ...]:
    """Return two cameras, 80 mm apart and 220 mm from the tags."""
    cameras = []
    for k, x in enumerate((-40.0, 40.0)):
        eye = np.array([x, 0, -220.0])
        z = -eye / np.linalg.norm(eye)
        right = np.cross([0.0, 1, 0], z)
        right /= np.linalg.norm(right)
        R = np.stack([right, np.cross(z, right), z])
        K = np.array([[440.0, 0, 180], [0, 440, 135], [0, 0, 1]])
        cameras.append(Camera(f"cam_{k}", SIZE, K, np.zeros(5), R, -R @ eye))
    return tuple(cameras)


def markers() -> Markers:
    """Return six tags in a plane; the first four are the anchor."""
    count = len(CENTERS)
    return Markers(
        "plate",
        "4X4_50",
        SIDE,
        np.arange(count),
        CENTERS,
        np.tile(FACING, (count, 1, 1)),
        np.arange(count) < 4,
    )


def level(seconds: float) -> float:
    """Return how far the last two tags are lifted at a time, 0 to 1; it does not repeat."""
    waves = np.sin(1.7 * seconds) + np.sin(3.1 * seconds + 1) + np.sin(4.7 * seconds + 2)
    return float(0.5 + waves / 6)


def marker_positions(seconds: float) -> np.ndarray:
    """Return the positions of the tags (6, 3) at a time, mm: the last two go back and forth."""
    positions = CENTERS.copy()
    positions[4:, 2] += 12 * level(seconds)
    return positions


def coverage() -> PoseCoverage:
    """Return the coverage of the pose `out`, in which the last two tags are lifted."""
    shapes = np.tile(CENTERS, (1, BINS, 1, 1))
    shapes[0, :, 4:, 2] += 12 * (np.arange(BINS)[:, None] + 1) / BINS
    return PoseCoverage(["out"], shapes, CENTERS)


class RenderedSource:
    """An `ImageSource` of rendered images at a constant rate.

    Args:
        camera: The camera.
        started_ns: Time of the first image, ns.
        disconnected_at: Time at which the camera is disconnected for a while, s.
        is_noticed: Returns whether the recording has noticed it; the camera does not return before.
    """

    def __init__(
        self,
        camera: Camera,
        started_ns: int,
        disconnected_at: float = float("inf"),
        is_noticed: Callable[[], bool] = lambda: True,
    ) -> None:
        self.name, self.size = camera.name, camera.size
        optics = Optics(blur=0.6, exposure=0, read_noise=1.0)
        self._renderer = Renderer(camera, optics, np.random.default_rng(0))
        self._started_ns, self._disconnected_at = started_ns, disconnected_at
        self._is_noticed, self._next = is_noticed, 0

    def _is_disconnected(self, seconds: float) -> bool:
        if seconds > self._disconnected_at + 0.6 and self._is_noticed():
            self._disconnected_at = float("inf")
        return seconds > self._disconnected_at

    def _now(self) -> float:
        return (time.monotonic_ns() - self._started_ns) / 1e9

    def start(self) -> None:
        now = self._now()
        if self._is_disconnected(now):
            raise CaptureError("is not connected", code="camera-unavailable")
        self._next = int(now * RATE) + 1

    def read(self, timeout: float) -> tuple[np.ndarray, int] | None:
        image_time = self._next / RATE
        time.sleep(max(image_time - self._now(), 0))
        if self._is_disconnected(image_time):
            raise CaptureError("was disconnected", code="camera-disconnected")
        self._next = max(self._next + 1, int(self._now() * RATE))
        family = dictionary("4X4_50")
        patches = tuple(
            Patch(k, family.pattern(k), c, FACING, SIDE)
            for k, c in enumerate(marker_positions(image_time))
        )
        image = self._renderer.shoot(Scene(patches=patches)).image
        return image, self._started_ns + round(image_time * 1e9)

    def close(self) -> None:
        pass


class Silent:
    """A screen that shows nothing and presses keys by the number of its views."""

    def __init__(self, keys: dict[int, str] | None = None) -> None:
        self.keys, self.view_count, self.notes = keys or {}, 0, set()
        self.first = self.last = None

    def key(self, timeout: float) -> str | None:
        time.sleep(timeout)
        self.view_count += 1
        return self.keys.get(self.view_count)

    def show(self, view: GuidedView) -> None:
        self.first = self.first or view
        self.last = view
        self.notes |= {(note.code, note.where) for note in view.notes}


def create_session(
    folder: Path, steps: list[tuple[str, float]], *, has_cameras: bool = True
) -> sessions.CaptureSession:
    """Create a session of steps, with cameras or without."""
    calibration = folder.parent / f"{folder.name}-cameras.toml"
    write_rig(calibration, cameras(), {})
    return sessions.create(
        folder,
        device="plate",
        steps=[sessions.PoseStep(*s) for s in steps],
        channels=("a", "b"),
        reference=(1500.0, 1500.0),
        calibration=calibration if has_cameras else None,
        markers=markers(),
    )


def make_cords() -> DeviceCords:
    """Return two cords that follow the last two tags."""
    return DeviceCords(
        ("a", "b"),
        np.array([100.0, 100.0]),
        lambda s: np.array([0.1, -0.06]) * level(s),
        TRAITS,
        np.random.default_rng(1),
    )


def record(
    session: sessions.CaptureSession,
    screen=None,
    disconnected_at: float = float("inf"),
    video: bool = False,
    levels: PoseCoverage | None = None,
) -> bool:
    """Record one run; the second camera is disconnected for a while at a time, s."""
    for camera in session.rig.cameras:
        Detector(camera, dictionary("4X4_50"))  # compiles before the time starts
    started_ns = time.monotonic_ns()
    board = ReadoutTwin(make_cords(), 1500.0)
    board.started_ns = started_ns
    source = Reader(lambda: board, "twin", ReadoutSettings(channels=2, rate=100))
    screen = screen or Silent()

    def is_noticed() -> bool:
        return ("camera-disconnected", "cam_1") in screen.notes

    def source_of(camera: Camera) -> RenderedSource:
        end = disconnected_at if camera.name == "cam_1" else float("inf")
        return RenderedSource(camera, started_ns, end, is_noticed)

    openers = [lambda c=c: source_of(c) for c in session.rig.cameras]
    return GuidedRecording(session, openers, source, screen, levels, auto=True, video=video).run()


def record_board_session(folder, seconds):
    """Return a session at rest with a recording of the read-out board, and without cameras."""
    session = create_session(folder, [("rest", 6.0)], has_cameras=False)
    record_board(session, seconds)
    return session


def record_board(session: sessions.CaptureSession, seconds: float) -> None:
    """Write a run of the board alone, without waiting; its first tenth is a rest."""
    run = session.folder / "run-1"
    run.mkdir()
    cords = make_cords()
    dividers = Dividers(np.full(2, 1500.0), 1024.0)
    with Recorder(run / sessions.BOARD, 2) as recorder:
        recorder.add(Event(0, "start", {"full_scale": 1024}))
        for k in range(int(seconds * 50)):
            ohm = cords.sample(k / 50, 0.02)
            sums = tuple(int(x) for x in np.round(16 * dividers.counts(ohm)))
            now = k / 50 + 0.02
            sample = Sample(k, int(now * 1e6), False, False, 16, sums)
            recorder.add(StampedSample(int(now * 1e9) + 2_000_000, int(now * 1e6), sample))
    lines = []
    for name, now in (("step", 0.0), ("done", seconds / 10)):
        event = {"event": name, "step": 0, "name": "rest", "host_ns": int(now * 1e9)}
        lines.append(json.dumps(event) + "\n")
    (run / sessions.LOG).write_text("".join(lines))


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    has_started = folder.exists()
    record(sessions.load(folder) if has_started else create_session(folder, [("rest", 60.0)]))
