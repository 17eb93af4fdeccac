"""Measure the peak memory of processing a session; an hour of six cameras must need < 1 GB.

    python -m tests.support.memory [--minutes 60] [--cameras 6] [--tags 20] [--seed 1] [--led]

The files are written as cameras (30 frames per second) and a board (four cords at 100 Hz) would
have recorded tags on smooth paths, without any image. A separate process processes them. Clocks are
compared by motion, or with `--led` by a lamp in the view of the first camera.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from defsense_fab.capture.cameras.rig_file import write_rig
from defsense_fab.capture.sessions import session as sessions
from defsense_fab.capture.tracking.reconstruction import tag_corners
from defsense_fab.core.arrays import Float
from defsense_fab.core.camera import Camera
from defsense_fab.core.markers import Markers
from defsense_fab.sensing.voltage_divider import Dividers

SIZE, FOCAL, SIDE = (1280, 720), 900.0, 15.0
RATE, BOARD_RATE = 30.0, 100.0  # Hz
NOISE, HIDDEN = 0.03, 0.02  # px; part of the tags that a picture lacks
GAINS = np.array([0.1, -0.06, 0.08, 0.03])
REFERENCE, OHM = 1500.0, 1200.0
RESTS = 5.0  # s at either end
BEGAN = 10**12  # ns
FACING = np.diag([1.0, -1.0, -1.0])  # a tag that faces the cameras
_BLOCK = 2000  # frames written at once
_CHILD = """
import json, sys, time
from pathlib import Path
from tests.support.memory import peak
from defsense_fab.workflow.sessions.processing import process_session
before, began = peak(), time.perf_counter()
process_session(Path(sys.argv[1]))
print(json.dumps([before, peak(), time.perf_counter() - began]))
"""


@dataclass(frozen=True)
class Measured:
    """Results of a measurement.

    Attributes:
        imports: Peak memory after the imports, MB.
        peak: Peak memory, MB.
        seconds: Time of processing.
    """

    imports: float
    peak: float
    seconds: float


def cameras(count: int) -> list[Camera]:
    """Return cameras on an arc 400 mm before the tags."""
    out = []
    for k, angle in enumerate(np.linspace(-0.6, 0.6, count)):
        eye = 400 * np.array([np.sin(angle), 0.15 * (-1) ** k, -np.cos(angle)])
        z = -eye / np.linalg.norm(eye)
        right = np.cross([0.0, 1, 0], z)
        right /= np.linalg.norm(right)
        R = np.stack([right, np.cross(z, right), z])
        K = np.array([[FOCAL, 0, 640.0], [0, FOCAL, 360.0], [0, 0, 1]])
        out.append(Camera(f"cam_{k}", SIZE, K, np.zeros(5), R, -R @ eye))
    return out


def markers(count: int) -> Markers:
    """Return tags in columns of four; the last eight are the anchor."""
    k = np.arange(count)
    centers = np.stack([(k // 4 - (count - 1) // 8) * 30.0, (k % 4 - 1.5) * 30.0, 0.0 * k], axis=1)
    return Markers(
        "plate", "4X4_50", SIDE, k, centers, np.tile(FACING, (count, 1, 1)), k >= count - 8
    )


def level(t: Float, seconds: float) -> Float:
    """Return the amount of bending (...,) at times in s: 0 at rest, and never twice the same."""
    waves = np.sin(1.7 * t) + np.sin(3.1 * t + 1) + np.sin(4.7 * t + 2)
    ends = np.clip(np.minimum(t - RESTS, seconds - RESTS - t), 0, 1)
    return np.asarray(ends * (0.5 + waves / 6))


def corners(tags: Markers, t: Float, seconds: float) -> Float:
    """Return the corners (t, m, 4, 3) mm of all tags at times (t,) s."""
    middle = np.tile(tags.centers, (len(t), 1, 1))
    free = np.maximum(tags.centers[tags.anchor, 0].min() - tags.centers[:, 0], 0.0)
    angle = 0.8 * level(t, seconds)[:, None] * free / max(free.max(), 1.0)
    middle[..., 0] += free * (1 - np.sinc(angle / np.pi))
    middle[..., 2] += free * angle / 2
    grip = np.stack([4 * np.sin(0.9 * t), 3 * np.sin(1.3 * t), 5 * np.sin(0.7 * t)], axis=1)
    return (middle + grip[:, None])[:, :, None] + tag_corners(SIDE) @ FACING.T


def create(folder: Path, count: int, tags: int) -> sessions.CaptureSession:
    """Create a session with `count` cameras and without recordings."""
    calibration = folder.with_name(f"{folder.name}-cameras.toml")
    write_rig(calibration, cameras(count), {})
    return sessions.create(
        folder, device="plate", steps=[sessions.PoseStep(sessions.REST, RESTS)],
        channels=tuple("abcd"), reference=(REFERENCE,) * 4, calibration=calibration,
        markers=markers(tags),
    )  # fmt: skip


def record(
    session: sessions.CaptureSession, seconds: float, rng: np.random.Generator, *,
    ohm: float = OHM, rests: bool = True, led: bool = False,
) -> Path:  # fmt: skip
    """Add a run of cords of `ohm` at rest.

    With `rests` both ends have finished rests; with `led` the first camera sees the board's LED.
    """
    run = session.folder / f"run-{len(session.runs) + 1}"
    run.mkdir()
    toggles = np.cumsum(rng.uniform(0.3, 1.2, int(2 * seconds) + 10))
    for k, camera in enumerate(session.rig.cameras):
        lit = toggles if led and k == 0 else None
        _record_camera(run, camera, session.markers, seconds, rng, k / RATE / 7, lit)
    _record_board(run, seconds, ohm, toggles if led else np.zeros(0))
    steps = ((0, 0.0, RESTS), (1, seconds - RESTS, seconds)) if rests else ()
    events = [
        {"event": kind, "step": step, "name": sessions.REST, "host_ns": BEGAN + int(1e9 * at)}
        for step, begin, end in steps
        for kind, at in (("step", begin), ("done", end))
    ]
    lines = [json.dumps(e) for e in [*events, {"event": "end", "why": "all steps were shown"}]]
    (run / sessions.LOG).write_text("\n".join(lines) + "\n")
    return run


def _record_camera(
    run: Path, camera: Camera, tags: Markers, seconds: float, rng: np.random.Generator,
    late: float, toggles: Float | None,
) -> None:  # fmt: skip
    t = np.arange(late, seconds, 1 / RATE)
    stamps = BEGAN + np.round(1e9 * t)
    lamp = np.full(len(t), np.nan)
    if toggles is not None:
        lamp = 20.0 + 180 * (np.searchsorted(toggles, t) % 2) + rng.normal(size=len(t))
    with (run / f"{camera.name}-frames.csv").open("w") as file:
        file.write(",".join(sessions.FRAME_COLUMNS) + "\n")
        rows = np.column_stack([np.arange(len(t)), stamps, lamp])
        file.write(("%d,%d,%.2f\n" * len(t)) % tuple(rows.ravel().tolist()))
    variances = [NOISE**2] * 4 + [NOISE**2 / 4]
    spread = ",".join(f"{v:.3e},0,{v:.3e}" for v in variances)
    line = "%d,%d,%d," + "%.4f," * 8 + spread + "\n"
    with (run / f"{camera.name}.csv").open("w") as file:
        file.write(",".join(sessions.TAG_COLUMNS) + "\n")
        for begin in range(0, len(t), _BLOCK):
            part = slice(begin, begin + _BLOCK)
            at = camera.to_camera(corners(tags, t[part], seconds))
            px = at[..., :2] / at[..., 2:] * camera.focal + camera.matrix[:2, 2]
            px += rng.normal(scale=NOISE, size=px.shape)
            frame, tag = np.nonzero(rng.random(px.shape[:2]) >= HIDDEN)
            rows = np.column_stack(
                [begin + frame, stamps[part][frame], tags.ids[tag], px[frame, tag].reshape(-1, 8)]
            )
            file.write((line * len(rows)) % tuple(rows.ravel().tolist()))


def _record_board(run: Path, seconds: float, ohm: float, toggles: Float) -> None:
    t = np.arange(0, seconds, 1 / BOARD_RATE)
    R = ohm * (1 + GAINS * level(t, seconds)[:, None])
    sums = np.round(16 * Dividers(np.full(4, REFERENCE), 1024.0).counts(R))
    ones = np.ones(len(t))
    rows = np.column_stack(
        [BEGAN + 1e9 * t + 2e6, 1e6 * t, np.arange(len(t)), np.searchsorted(toggles, t) % 2,
         0 * ones, 16 * ones, sums]
    )  # fmt: skip
    head = "# defsense recording 1\nhost_ns,device_us,counter,led,late,averages,s1,s2,s3,s4\n"
    start = json.dumps({"event": "start", "host_ns": BEGAN, "full_scale": 1024})
    with (run / sessions.BOARD).open("w") as file:
        file.write(f"{head}# {start}\n")
        file.write((",".join(["%d"] * 10) + "\n") * len(rows) % tuple(rows.ravel().tolist()))


def peak() -> float:
    """Return the peak memory of this process, MB.

    `ru_maxrss` is not used, because it includes the memory of the parent at the start.
    """
    status = Path("/proc/self/status").read_text()
    line = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) * 1024 / 1e6


def measure(folder: Path) -> Measured:
    """Process a session in a separate process (Linux) and return the measurement."""
    process = subprocess.run(
        [sys.executable, "-c", _CHILD, str(folder.resolve())], check=True, text=True,
        stdout=subprocess.PIPE, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    return Measured(*json.loads(process.stdout))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.support.memory")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--cameras", type=int, default=6)
    parser.add_argument("--tags", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--led", action="store_true", help="a lamp in the first camera's view")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        session = create(Path(folder) / "session", options.cameras, options.tags)
        began = time.perf_counter()
        rng = np.random.default_rng(options.seed)
        run = record(session, 60 * options.minutes, rng, led=options.led)
        size = sum(p.stat().st_size for p in run.iterdir()) / 1e6
        print(f"recorded {size:.0f} MB in {time.perf_counter() - began:.0f} s", flush=True)
        measured = measure(session.folder)
        quality = json.loads((session.folder / "quality.json").read_text())
    print(
        f"{options.minutes:g} min of {options.cameras} cameras, {options.tags} tags:"
        f" {quality['frames']} frames in {measured.seconds:.0f} s; peak {measured.peak:.0f} MB,"
        f" of which imports {measured.imports:.0f} MB"
    )


if __name__ == "__main__":
    main()
