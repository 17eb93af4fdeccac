"""A small set of things before two small cameras, for tests of capture sessions.

Run as a program it records a session into the folder that it is given, until it is killed.
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
    """Two, 80 mm apart, 220 mm before the tags."""
    out = []
    for k, x in enumerate((-40.0, 40.0)):
        eye = np.array([x, 0, -220.0])
        z = -eye / np.linalg.norm(eye)
        right = np.cross([0.0, 1, 0], z)
        right /= np.linalg.norm(right)
        R = np.stack([right, np.cross(z, right), z])
        K = np.array([[440.0, 0, 180], [0, 440, 135], [0, 0, 1]])
        out.append(Camera(f"cam_{k}", SIZE, K, np.zeros(5), R, -R @ eye))
    return tuple(out)


def markers() -> Markers:
    """Six tags in a plane; the first four are the anchor."""
    count = len(CENTERS)
    return Markers(
        "plate", "4X4_50", SIDE, np.arange(count), CENTERS, np.tile(FACING, (count, 1, 1)),
        np.arange(count) < 4,
    )  # fmt: skip


def level(seconds: float) -> float:
    """How far the last two tags are out, 0 to 1, never twice alike."""
    waves = np.sin(1.7 * seconds) + np.sin(3.1 * seconds + 1) + np.sin(4.7 * seconds + 2)
    return float(0.5 + waves / 6)


def places(seconds: float) -> np.ndarray:
    """Of the tags (6, 3) mm: the last two go back and forth."""
    out = CENTERS.copy()
    out[4:, 2] += 12 * level(seconds)
    return out


def coverage() -> PoseCoverage:
    """Of the one pose `out`, in which the last two tags are out."""
    shapes = np.tile(CENTERS, (1, BINS, 1, 1))
    shapes[0, :, 4:, 2] += 12 * (np.arange(BINS)[:, None] + 1) / BINS
    return PoseCoverage(["out"], shapes, CENTERS)


class Pictures:
    """Rendered `Images` at a steady rate; at the time `gone`, s, they cease for a while, and until
    that is `told`."""

    def __init__(
        self,
        camera: Camera,
        began_ns: int,
        gone: float = float("inf"),
        told: Callable[[], bool] = lambda: True,
    ) -> None:
        self.name, self.size = camera.name, camera.size
        self._renderer = Renderer(
            camera, Optics(blur=0.6, exposure=0, read_noise=1.0), np.random.default_rng(0)
        )
        self._began, self._gone, self._told, self._next = began_ns, gone, told, 0

    def _away(self, at: float) -> bool:
        if at > self._gone + 0.6 and self._told():
            self._gone = float("inf")
        return at > self._gone

    def start(self) -> None:
        now = (time.monotonic_ns() - self._began) / 1e9
        if self._away(now):
            raise CaptureError("not there")
        self._next = int(now * RATE) + 1

    def read(self, timeout: float) -> tuple[np.ndarray, int] | None:
        at = self._next / RATE
        time.sleep(max(at - (time.monotonic_ns() - self._began) / 1e9, 0))
        if self._away(at):
            raise CaptureError("unplugged")
        now = (time.monotonic_ns() - self._began) / 1e9
        self._next = max(self._next + 1, int(now * RATE))
        family = dictionary("4X4_50")
        patches = tuple(
            Patch(k, family.pattern(k), c, FACING, SIDE) for k, c in enumerate(places(at))
        )
        return self._renderer.shoot(Scene(patches=patches)).image, self._began + round(at * 1e9)

    def close(self) -> None:
        pass


class Silent:
    """A screen that nobody looks at; keys by the number of looks."""

    def __init__(self, keys: dict[int, str] | None = None) -> None:
        self.keys, self.looks, self.notes = keys or {}, 0, set()
        self.first = self.last = None

    def key(self, timeout: float) -> str | None:
        time.sleep(timeout)
        self.looks += 1
        return self.keys.get(self.looks)

    def show(self, view) -> None:
        self.first = self.first or view
        self.last = view
        self.notes |= set(view.notes)


def begin(
    folder: Path, steps: list[tuple[str, float]], *, seen: bool = True
) -> sessions.CaptureSession:
    """A session of these steps, with cameras or without."""
    calibration = folder.parent / f"{folder.name}-cameras.toml"
    write_rig(calibration, cameras(), {})
    return sessions.create(
        folder, device="plate", steps=[sessions.PoseStep(*s) for s in steps],
        channels=("a", "b"), reference=(1500.0, 1500.0), calibration=calibration if seen else None,
        markers=markers(),
    )  # fmt: skip


def record(
    session: sessions.CaptureSession,
    screen=None,
    gone: float = float("inf"),
    video: bool = False,
    levels: PoseCoverage | None = None,
) -> bool:
    """One run of it."""
    for camera in session.rig.cameras:
        Detector(camera, dictionary("4X4_50"))  # compiles before the time begins
    began = time.monotonic_ns()
    cords = DeviceCords(
        ("a", "b"), np.array([100.0, 100.0]), lambda s: np.array([0.1, -0.06]) * level(s), TRAITS,
        np.random.default_rng(1),
    )  # fmt: skip
    board = ReadoutTwin(cords, 1500.0)
    board.started_ns = began
    source = Reader(lambda: board, "twin", ReadoutSettings(channels=2, rate=100))
    screen = screen or Silent()

    def pictures(camera: Camera) -> Pictures:
        leaves = gone if camera.name == "cam_1" else float("inf")
        return Pictures(
            camera, began, leaves, lambda: any("disconnected" in n for n in screen.notes)
        )

    openers = [lambda c=c: pictures(c) for c in session.rig.cameras]
    return GuidedRecording(session, openers, source, screen, levels, auto=True, video=video).run()


def board_alone(session: sessions.CaptureSession, seconds: float) -> None:
    """A run in which the board alone was recorded, without waiting for it: rest is the first tenth
    and the last."""
    run = session.folder / "run-1"
    run.mkdir()
    cords = DeviceCords(
        ("a", "b"), np.array([100.0, 100.0]), lambda s: np.array([0.1, -0.06]) * level(s), TRAITS,
        np.random.default_rng(1),
    )  # fmt: skip
    dividers = Dividers(np.full(2, 1500.0), 1024.0)
    with Recorder(run / sessions.BOARD, 2) as recorder:
        recorder.add(Event(0, "start", {"full_scale": 1024}))
        for k in range(int(seconds * 50)):
            ohm = cords.measure(0.02, 50)[1][0]
            sums = tuple(int(x) for x in np.round(16 * dividers.counts(ohm)))
            at = k / 50 + 0.02
            sample = Sample(k, int(at * 1e6), False, False, 16, sums)
            recorder.add(StampedSample(int(at * 1e9) + 2_000_000, int(at * 1e6), sample))
    lines = []
    for name, at in (("step", 0.0), ("done", seconds / 10)):
        event = {"event": name, "step": 0, "name": "rest", "host_ns": int(at * 1e9)}
        lines.append(json.dumps(event) + "\n")
    (run / sessions.LOG).write_text("".join(lines))


if __name__ == "__main__":
    where = Path(sys.argv[1])
    record(sessions.load(where) if where.exists() else begin(where, [("rest", 60.0)]))
