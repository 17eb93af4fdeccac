"""The twin of a built device in real time: it moves before cameras, and a board reads its cords."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...capture.readout.reader import Reader, ReadoutSettings
from ...capture.sessions.pose_coverage import BINS, PoseCoverage
from ...core.arrays import Float
from ...core.camera import Camera
from ...core.device.device import Device
from ...core.errors import CaptureError
from ...core.markers import Markers
from ...sensing.built_cord import CordReading
from ..devices.filmed_device import FilmedDevice
from ..devices.simulated_device import SimulatedDevice, load_simulated_device
from ..electronics.cords import CordTraits, DeviceCords
from ..electronics.readout_board import ReadoutTwin
from ..filming.camera_kinds import CAMERA_KINDS
from ..filming.cameras import LiveCamera
from ..options import TWIN, TwinCameras
from ..scenes.device_motion import PosePlayer
from ..scenes.device_twin import blend
from ..scenes.scene import Scene

SWAY = 3.0  # mm and degrees, of the hand that holds the device
MAX_BODY_TRIANGLES = 60_000  # bodies with more triangles are not drawn
FRAME_RATE_HZ = 15.0
#: Offset, s, and relative drift of the clock of the twin's read-out board.
OFFSET, DRIFT = 0.35, 60e-6
CORD_PLAY, CORD_HEALING, CORD_HEALING_S = 0.001, 0.03, 2.0
DEFAULT_CAMERAS = TwinCameras()


@dataclass(frozen=True)
class LiveTwin:
    """The twin of a device with its cameras and its read-out board; call `close` after use.

    Attributes:
        cameras: The cameras.
        sources: The images of the cameras.
        player: Moves the device.
        board: The read-out board.
        channels: Names of the channels.
        started_ns: Value of `time.monotonic_ns` at 0 s of the twin.
        reference: Reference resistance of the board's dividers, ohm.
    """

    cameras: tuple[Camera, ...]
    sources: tuple[LiveCamera, ...]
    player: PosePlayer
    board: ReadoutTwin
    channels: tuple[str, ...]
    started_ns: int
    reference: float

    def open_reader(self, settings: ReadoutSettings) -> Reader:
        """Return a source of the samples of the read-out board."""
        return Reader(lambda: self.board, TWIN, settings)

    def perform(self, name: str, seconds: float) -> None:
        """Show a pose for some seconds from now on."""
        self.player.perform(name, (time.monotonic_ns() - self.started_ns) / 1e9, seconds)

    def close(self) -> None:
        """Stop the cameras."""
        for source in self.sources:
            source.close()


def start_live_twin(
    device: Device,
    markers: Markers,
    filming: TwinCameras = DEFAULT_CAMERAS,
) -> LiveTwin:
    """Start the twin of a built device.

    Args:
        device: The device.
        markers: The tags on it.
        filming: Number and kind of the cameras, and the seed of everything that is random.

    Raises:
        CaptureError: The device is not built.
    """
    seed, count, kind = filming.seed, filming.count, CAMERA_KINDS[filming.kind]
    rng = np.random.default_rng(seed)
    sim = load_simulated_device(device, markers.centers)
    player = PosePlayer(sim.ramps, seed)
    cords = _make_cords(device, sim, player, rng)
    reference = float(np.median(cords.rest))
    board = ReadoutTwin(cords, reference, offset=OFFSET, drift=DRIFT)
    filmed = FilmedDevice(sim.rest, sim.skin, markers, kind, count, SWAY, rng)
    has_body = len(sim.rest.faces) <= MAX_BODY_TRIANGLES

    def scene_at(seconds: float) -> Scene:
        weights = _state_weights(sim, player, seconds)
        scene = filmed.scene(weights, seconds, is_led_on=board.is_led_on(seconds))
        return scene if has_body else scene.replace(body=None)

    phases = rng.random(count) if kind.free_running else np.zeros(count)
    sources = tuple(
        LiveCamera(
            camera,
            scene_at,
            kind.optics,
            np.random.default_rng([seed, k]),
            board.started_ns,
            FRAME_RATE_HZ,
            kind.delay,
            kind.jitter,
            float(phases[k]),
        )
        for k, camera in enumerate(filmed.cameras)
    )
    return LiveTwin(
        cameras=filmed.cameras,
        sources=sources,
        player=player,
        board=board,
        channels=sim.names,
        started_ns=board.started_ns,
        reference=reference,
    )


def _state_weights(sim: SimulatedDevice, player: PosePlayer, seconds: float) -> Float:
    """Return the weights (s,) of all states of the device at a time, s."""
    weights = player.weights(seconds)
    return np.pad(weights, (0, len(sim.skin) - len(weights)))


def _make_cords(
    device: Device, sim: SimulatedDevice, player: PosePlayer, rng: np.random.Generator
) -> DeviceCords:
    reading = CordReading.from_device(device)

    def signals_at(seconds: float) -> Float:
        weights = _state_weights(sim, player, seconds)
        return np.array(
            [
                float(reading.signals(cord, (cord.path + blend(u, weights))[None])[0])
                for cord, u in zip(sim.cords, sim.moved, strict=True)
            ]
        )

    traits = CordTraits(
        reading.response,
        noise=device.cord.noise,
        ohm_per_mm=device.cord.ohm_per_mm,
        play=CORD_PLAY,
        healing=CORD_HEALING,
        time=CORD_HEALING_S,
    )
    return DeviceCords(sim.names, sim.lengths, signals_at, traits, rng)


def write_true_cameras(twin: LiveTwin, path: Path) -> None:
    """Write the true cameras of the twin like a calibration."""
    from ...capture.cameras.rig_file import write_rig

    write_rig(path, twin.cameras, {"adjusted": True, "twin": True})


def load_pose_coverage(device: Device, markers: Markers) -> PoseCoverage | None:
    """Return a measure of how far each pose was shown; None for a device that is not built."""
    try:
        sim = load_simulated_device(device, markers.centers)
    except CaptureError:
        return None
    steps = np.arange(1, BINS + 1) / BINS
    shapes = [
        markers.centers + np.tensordot(r.weights(steps * r.levels[-1]), sim.shown[r.states], 1)
        for r in sim.ramps
    ]
    return PoseCoverage([r.name for r in sim.ramps], np.array(shapes), markers.centers)
