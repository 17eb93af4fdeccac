"""A built device that moves before cameras, and whose read-out board reads its cords, as a twin."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

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
from ..devices.simulated_device import load_simulated_device
from ..electronics.cords import CordTraits, DeviceCords
from ..electronics.readout_board import ReadoutTwin
from ..electronics.virtual_port import VirtualPort, open_virtual_port
from ..filming.camera_kinds import (
    CAMERA_KINDS,
    DEFAULT_CAMERA_KIND,
    print_patch,
    simulate_passing_finger,
)
from ..filming.cameras import LiveCamera
from ..scenes.device_motion import PosePlayer, draw_sway
from ..scenes.device_twin import DeviceTwin, blend
from ..scenes.scene import Backdrop, Led, Patch, Scene

_STEADY = 3.0  # mm and degrees of the hand that holds the device
_DENSE = 60_000  # triangles, above which a body is not drawn
_FRAMES = 15.0  # frames per second
#: Of the twin's read-out board: its clock against the host's, s and relative.
OFFSET, DRIFT = 0.35, 60e-6


@dataclass
class LiveTwin:
    """The twin of a device and of what looks at it; `close` it after use."""

    cameras: tuple[Camera, ...]
    sources: tuple[LiveCamera, ...]
    puppet: PosePlayer
    board: ReadoutTwin
    channels: tuple[str, ...]
    truth: DeviceTwin
    began_ns: int
    line: VirtualPort | None = None
    extra: dict[str, Any] = field(default_factory=dict)

    def port(self) -> str:
        """A pseudo-terminal or local socket on which the read-out board speaks."""
        if self.line is None:
            self.line = open_virtual_port(self.board)
        return self.line.port

    def perform(self, name: str, seconds: float) -> None:
        """Show a pose from now on."""
        self.puppet.perform(name, (time.monotonic_ns() - self.began_ns) / 1e9, seconds)

    def close(self) -> None:
        for source in self.sources:
            source.close()
        if self.line is not None:
            self.line.close()


def start_live_twin(
    device: Device, markers: Markers, seed: int = 1, count: int = 2, rate: float = _FRAMES,
    kind: str = DEFAULT_CAMERA_KIND, *, led: bool = True,
) -> LiveTwin:  # fmt: skip
    """A twin of a built device with its tags, `count` cameras of a `kind` (`camera_kinds.py`) and a
    read-out board. Raises CaptureError."""
    if kind not in CAMERA_KINDS:
        raise CaptureError(f"twin: no cameras are called {kind}; there are {', '.join(CAMERA_KINDS)}")
    own = CAMERA_KINDS[kind]
    rng = np.random.default_rng(seed)
    sim = load_simulated_device(device, markers.centers)
    family = dictionary(markers.dictionary)
    seats = tuple(
        print_patch(Patch(int(n), family.pattern(int(n)), c, a, markers.size), own.ink, own.curl)
        for n, c, a in zip(markers.ids, markers.centers, markers.axes, strict=True)
    )
    twin = DeviceTwin(sim.rest, sim.skin, seats)
    puppet = PosePlayer(sim.ramps, seed)
    reading = CordReading.from_device(device)

    def signals_at(seconds: float) -> Float:
        w = puppet.weights(seconds)
        states = np.pad(w, (0, len(sim.skin) - len(w)))
        return np.array(
            [
                float(reading.signals(cord, (cord.path + blend(u, states))[None])[0])
                for cord, u in zip(sim.cords, sim.moved, strict=True)
            ]
        )

    traits = CordTraits(
        reading.response, noise=device.cord.noise, ohm_per_mm=device.cord.ohm_per_mm, play=0.001,
        healing=0.03, time=2.0,
    )  # fmt: skip
    cords = DeviceCords(sim.names, sim.lengths, signals_at, traits, rng)
    reference = float(np.median(cords.rest))
    board = ReadoutTwin(cords, reference, offset=OFFSET, drift=DRIFT)
    cameras = place_cameras(sim.rest, markers, count)
    middle = sim.rest.bounds.mean(axis=0)
    hand = draw_sway(rng, middle, shift=_STEADY, degrees=_STEADY)
    place = place_led(cameras[0], sim.rest)
    around = Scene(backdrop=Backdrop(), gloss=own.gloss)
    towards = np.mean([c.center for c in cameras], axis=0) - middle
    passing = simulate_passing_finger(rng, sim.rest.bounds, towards / np.linalg.norm(towards))
    drawn = len(sim.rest.faces) <= _DENSE

    def scene_at(seconds: float) -> Scene:
        w = puppet.weights(seconds)
        states = np.pad(w, (0, len(sim.skin) - len(w)))
        found = twin.scene(states, hand.pose_at(seconds), around)
        shown = found if drawn else found.replace(body=None)
        if own.passing:
            shown = shown.replace(occluders=passing(seconds))
        if led:
            shown = shown.replace(led=Led(place, board.is_led_on(seconds), radius=3.0))
        return shown

    phases = rng.random(count) if own.free_running else np.zeros(count)
    sources = tuple(
        LiveCamera(
            c, scene_at, own.optics, np.random.default_rng([seed, k]), board.started_ns, rate,
            own.delay, own.jitter, float(phases[k]),
        )
        for k, c in enumerate(cameras)
    )  # fmt: skip
    return LiveTwin(
        cameras, sources, puppet, board, sim.names, twin, board.started_ns,
        extra={"reference": reference, "hand": hand, "states": len(sim.skin)},
    )  # fmt: skip


def write_true_cameras(twin: LiveTwin, path: Path) -> None:
    """Write the twin's cameras as a calibration has them."""
    from ...capture.cameras.rig_file import write_rig

    write_rig(path, twin.cameras, {"adjusted": True, "twin": True})


def load_pose_coverage(device: Device, markers: Markers) -> PoseCoverage | None:
    """What tells how far each pose was shown; None for a device that is not built."""
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
