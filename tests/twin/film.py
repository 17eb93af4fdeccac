"""Films of simulated scenes, for tests: a video, its time stamps and the truth about it.

The video itself has a constant rate. The time stamps of the camera's clock are in a table next to
it (`.csv`: frame, time), as programs that record cameras write them; the truth is in `.npz`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import cv2
import numpy as np

from defsense_fab.core.arrays import Bool, Float, Int
from defsense_fab.core.camera import Camera
from defsense_fab.twin.filming.camera_optics import Optics
from defsense_fab.twin.filming.cameras import expose
from defsense_fab.twin.filming.renderer import Renderer
from defsense_fab.twin.scenes.scene import Scene


@dataclass(frozen=True)
class Shutter:
    """The clock of a camera and its faults.

    Attributes:
        rate: Frame rate by the camera's clock, Hz.
        offset: Offset of the camera's clock, s; it shows offset + (1 + drift) * true time.
        drift: Relative drift of the camera's clock.
        jitter: Mean delay of the time stamps, s.
        dropped: Share of frames that are missing.
        repeated: Share of frames that repeat the previous one.
    """

    rate: float = 30.0
    offset: float = 0.0
    drift: float = 0.0
    jitter: float = 0.0
    dropped: float = 0.0
    repeated: float = 0.0

    def schedule(self, duration: float, rng: np.random.Generator) -> tuple[Int, Float, Float, Bool]:
        """Return the frames (f) of a film of `duration` s.

        Returns:
            Frame numbers (f,), true times (f,) s, increasing time stamps (f,) s, and whether each
            frame repeats the previous one (f,), whose time it then has.
        """
        number = np.arange(int(np.floor(duration * self.rate + 1e-9)))
        is_kept = rng.random(len(number)) >= self.dropped
        is_kept[:1] = True
        number = number[is_kept]
        time = number / self.rate / (1 + self.drift)
        delay = self.jitter * rng.exponential(size=len(number))
        delay = np.minimum(delay, 0.9 / self.rate)
        stamp = self.offset + (1 + self.drift) * time + delay
        repeats = rng.random(len(number)) < self.repeated
        repeats[:1] = False
        source = np.maximum.accumulate(np.where(repeats, 0, np.arange(len(number))))
        return number, time[source], stamp, repeats


@dataclass(frozen=True)
class FilmTruth:
    """What f frames of a film of m patches show.

    Attributes:
        number: Frame numbers at the camera (f,).
        time: True times (f,) s.
        stamp: Time stamps of the camera (f,) s.
        repeats: Whether a frame repeats the previous one (f,).
        led: Whether the LED is on (f,).
        ids: Numbers of the patches (m,).
        centers: Centers of the patches (f, m, 3) mm.
        corners: Corners of the patches (f, m, 4, 3) mm.
        pixels: Corners of the patches (f, m, 4, 2) px.
        visible: Visible share of the patches (f, m).
    """

    number: Int
    time: Float
    stamp: Float
    repeats: Bool
    led: Bool
    ids: Int
    centers: Float
    corners: Float
    pixels: Float
    visible: Float


def record_film(
    path: Path,
    camera: Camera,
    scene_at: Callable[[float], Scene],
    duration: float,
    shutter: Shutter,
    optics: Optics,
    rng: np.random.Generator,
    codec: str = "FFV1",
) -> FilmTruth:
    """Write a film of `scene_at(s)` to `path`, its time stamps and its truth next to it.

    The codec FFV1 is lossless. All frames have the same patches, at least one.
    """
    number, times, stamp, repeats = shutter.schedule(duration, rng)
    fourcc = cv2.VideoWriter.fourcc(*codec)
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, fourcc, shutter.rate, camera.size, False)
    assert writer.isOpened(), path
    renderer = Renderer(camera, optics, rng)
    scenes: list[Scene] = []
    shown: list[tuple[Float, Float]] = []
    for time, is_repeated in zip(times, repeats, strict=True):
        if not is_repeated:
            scene, instants = expose(scene_at, camera, float(time), optics)
            rendered = renderer.shoot(scene, instants, float(time))
        writer.write(rendered.image)
        scenes.append(scene.replace(body=None))  # bodies would fill the memory
        shown.append((rendered.corners, rendered.visible))
    writer.release()
    lines = (f"{k},{t:.9f}" for k, t in enumerate(stamp))
    path.with_suffix(".csv").write_text("\n".join(["frame,time", *lines]) + "\n")
    truth = _collect_truth(scenes, shown, (number, times, stamp, repeats))
    arrays = {f.name: getattr(truth, f.name) for f in fields(FilmTruth)}
    np.savez_compressed(path.with_suffix(".npz"), **arrays)
    return truth


def _collect_truth(
    scenes: list[Scene],
    shown: list[tuple[Float, Float]],
    schedule: tuple[Int, Float, Float, Bool],
) -> FilmTruth:
    m = len(scenes[0].patches)
    return FilmTruth(
        *schedule,
        np.array([s.led is not None and s.led.is_on for s in scenes]),
        np.array([p.number for p in scenes[0].patches], int),
        np.array([p.center for s in scenes for p in s.patches]).reshape(-1, m, 3),
        np.array([p.corners for s in scenes for p in s.patches]).reshape(-1, m, 4, 3),
        np.array([corners for corners, _ in shown]).reshape(-1, m, 4, 2),
        np.array([visible for _, visible in shown]).reshape(-1, m),
    )


def load_truth(path: Path) -> FilmTruth:
    """Read the truth that `record_film` wrote."""
    with np.load(path, allow_pickle=False) as data:
        return FilmTruth(**{f.name: data[f.name] for f in fields(FilmTruth)})
