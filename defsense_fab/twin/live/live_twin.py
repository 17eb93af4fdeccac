"""The twin of a built device in real time: it moves before cameras, and a board reads its cords."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...capture.sessions.pose_coverage import BINS, PoseCoverage
from ...capture.tags.tag_patterns import dictionary
from ...core.arrays import Float
from ...core.camera import Camera
from ...core.device.device import Device
from ...core.errors import CaptureError
from ...core.markers import Markers
from ...sensing.built_cord import CordReading
from ..devices.camera_places import place_cameras, place_led
from ..devices.simulated_device import SimulatedDevice, load_simulated_device
from ..devices.twin_traits import unknown_camera_kind
from ..electronics.cords import CordTraits, DeviceCords
from ..electronics.readout_board import ReadoutTwin
from ..electronics.virtual_port import VirtualPort, open_virtual_port
from ..filming.camera_kinds import (
    CAMERA_KINDS,
    DEFAULT_CAMERA_KIND,
    CameraKind,
    print_patch,
    simulate_passing_finger,
)
from ..filming.cameras import LiveCamera
from ..scenes.device_motion import PosePlayer, draw_sway
from ..scenes.device_twin import DeviceTwin, blend
from ..scenes.scene import Backdrop, Led, Patch, Scene

SWAY = 3.0  # mm and degrees, of the hand that holds the device
MAX_BODY_TRIANGLES = 60_000  # bodies with more triangles are not drawn
FRAME_RATE_HZ = 15.0
LED_RADIUS_MM = 3.0
#: Offset, s, and relative drift of the clock of the twin's read-out board.
OFFSET, DRIFT = 0.35, 60e-6
CORD_PLAY, CORD_HEALING, CORD_HEALING_S = 0.001, 0.03, 2.0


@dataclass
class LiveTwin:
    """The twin of a device with its cameras and its read-out board; call `close` after use.

    Attributes:
        cameras: The cameras.
        sources: The images of the cameras.
        player: Moves the device.
        board: The read-out board.
        channels: Names of the channels.
        device: The moving device.
        started_ns: Value of `time.monotonic_ns` at 0 s of the twin.
        reference: Reference resistance of the board's dividers, ohm.
        state_count: Number of simulated states of the device.
        line: The virtual port of the board, once `port` was called.
    """

    cameras: tuple[Camera, ...]
    sources: tuple[LiveCamera, ...]
    player: PosePlayer
    board: ReadoutTwin
    channels: tuple[str, ...]
    device: DeviceTwin
    started_ns: int
    reference: float
    state_count: int
    line: VirtualPort | None = None

    def port(self) -> str:
        """Return the name of a pseudo-terminal or local socket of the read-out board."""
        if self.line is None:
            self.line = open_virtual_port(self.board)
        return self.line.port

    def perform(self, name: str, seconds: float) -> None:
        """Show a pose for some seconds from now on."""
        self.player.perform(name, (time.monotonic_ns() - self.started_ns) / 1e9, seconds)

    def close(self) -> None:
        """Stop the cameras and close the port."""
        for source in self.sources:
            source.close()
        if self.line is not None:
            self.line.close()


def start_live_twin(
    device: Device,
    markers: Markers,
    seed: int = 1,
    count: int = 2,
    rate: float = FRAME_RATE_HZ,
    kind: str = DEFAULT_CAMERA_KIND,
    *,
    led: bool = True,
) -> LiveTwin:
    """Start the twin of a built device.

    Args:
        device: The device.
        markers: The tags on it.
        seed: Seed of everything that is random.
        count: Number of cameras.
        rate: Frame rate, Hz.
        kind: Kind of the cameras, a key of `CAMERA_KINDS`.
        led: Whether the LED of the board is visible.

    Raises:
        CaptureError: The device is not built, or there is no such kind of cameras
            (`unknown-camera-kind`).
    """
    if kind not in CAMERA_KINDS:
        raise unknown_camera_kind(kind)
    traits = CAMERA_KINDS[kind]
    rng = np.random.default_rng(seed)
    sim = load_simulated_device(device, markers.centers)
    twin = DeviceTwin(sim.rest, sim.skin, _print_tags(markers, traits))
    player = PosePlayer(sim.ramps, seed)
    cords = _make_cords(device, sim, player, rng)
    reference = float(np.median(cords.rest))
    board = ReadoutTwin(cords, reference, offset=OFFSET, drift=DRIFT)
    cameras = place_cameras(sim.rest, markers, count)
    middle = sim.rest.bounds.mean(axis=0)
    sway = draw_sway(rng, middle, shift=SWAY, degrees=SWAY)
    led_position = place_led(cameras[0], sim.rest)
    surroundings = Scene(backdrop=Backdrop(), gloss=traits.gloss)
    towards = np.mean([c.center for c in cameras], axis=0) - middle
    finger_at = simulate_passing_finger(rng, sim.rest.bounds, towards / np.linalg.norm(towards))
    has_body = len(sim.rest.faces) <= MAX_BODY_TRIANGLES

    def scene_at(seconds: float) -> Scene:
        scene = twin.scene(
            _state_weights(sim, player, seconds), sway.pose_at(seconds), surroundings
        )
        if not has_body:
            scene = scene.replace(body=None)
        if traits.passing:
            scene = scene.replace(occluders=finger_at(seconds))
        if led:
            light = Led(led_position, board.is_led_on(seconds), radius=LED_RADIUS_MM)
            scene = scene.replace(led=light)
        return scene

    phases = rng.random(count) if traits.free_running else np.zeros(count)
    sources = tuple(
        LiveCamera(
            camera,
            scene_at,
            traits.optics,
            np.random.default_rng([seed, k]),
            board.started_ns,
            rate,
            traits.delay,
            traits.jitter,
            float(phases[k]),
        )
        for k, camera in enumerate(cameras)
    )
    return LiveTwin(
        cameras=cameras,
        sources=sources,
        player=player,
        board=board,
        channels=sim.names,
        device=twin,
        started_ns=board.started_ns,
        reference=reference,
        state_count=len(sim.skin),
    )


def _print_tags(markers: Markers, kind: CameraKind) -> tuple[Patch, ...]:
    family = dictionary(markers.dictionary)
    return tuple(
        print_patch(Patch(int(n), family.pattern(int(n)), c, a, markers.size), kind.ink, kind.curl)
        for n, c, a in zip(markers.ids, markers.centers, markers.axes, strict=True)
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
