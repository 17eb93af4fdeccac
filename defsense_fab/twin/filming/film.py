"""Films that the twin's cameras take: a video, its time stamps, and what is true about it.

A video's own times are those of a constant rate. What the camera's clock said is in a table beside
it (`.csv`: frame, time), as a program that records a camera keeps it; the truth is in `.npz`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path

import cv2
import numpy as np

from ...core.arrays import Bool, Float, Int
from ...core.camera import Camera
from ...core.errors import CaptureError, StorageError
from ...core.storage.files import replacing, write_text
from ..scenes.scene import Scene
from .camera_optics import Optics
from .exposure import expose
from .renderer import Renderer

CODECS = ("FFV1", "MJPG")  # the first keeps every grey level


@dataclass(frozen=True)
class Shutter:
    """A camera's clock and its faults. It says offset + (1 + drift) * true time, s, and takes
    `rate` frames per second of its own; frames arrive late by `jitter` s on average; a part
    `dropped` of them is missing, a part `repeated` is replaced by the frame before."""

    rate: float = 30.0
    offset: float = 0.0
    drift: float = 0.0
    jitter: float = 0.0
    dropped: float = 0.0
    repeated: float = 0.0

    def __post_init__(self) -> None:
        parts = (self.dropped, self.repeated)
        if not (self.rate > 0 and self.jitter >= 0 and all(0 <= p < 1 for p in parts)):
            raise CaptureError(
                "the rate must be positive, the jitter at least 0, and shares from 0 to below 1",
                code="setting-out-of-range",
                where="shutter",
                record="shutter",
            )

    def schedule(self, duration: float, rng: np.random.Generator) -> tuple[Int, Float, Float, Bool]:
        """Of f frames within so many s: their numbers, true times and stamps in s (in order), and
        whether they repeat the one before (their time is that one's)."""
        number = np.arange(int(np.floor(duration * self.rate + 1e-9)))
        kept = rng.random(len(number)) >= self.dropped
        kept[:1] = True
        number = number[kept]
        time = number / self.rate / (1 + self.drift)
        late = self.jitter * rng.exponential(size=len(number))
        late = np.minimum(late, 0.9 / self.rate)
        stamp = self.offset + (1 + self.drift) * time + late
        repeats = rng.random(len(number)) < self.repeated
        repeats[:1] = False
        source = np.maximum.accumulate(np.where(repeats, 0, np.arange(len(number))))
        return number, time[source], stamp, repeats


@dataclass(frozen=True)
class FilmTruth:
    """What f frames of a record_film show: their `number` (f,) at the camera, the true `time` (f,) s, the
    camera's `stamp` (f,) s, whether it `repeats` (f,) the one before, and the `led` (f,); of the m
    patches their `ids` (m,), `centers` (f, m, 3) and `corners` (f, m, 4, 3) mm, `pixels`
    (f, m, 4, 2) and the `visible` part (f, m)."""

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
    """Take a record_film of `scene_at`(s), s; writes `path`, its table of stamps and its truth beside it.
    Raises CaptureError for a codec that is not known, StorageError where nothing can be written."""
    if codec not in CODECS:
        raise CaptureError(
            f"codec {codec!r} is not supported",
            code="unknown-codec",
            where=path.name,
            action=f"Use one of {', '.join(CODECS)}",
            codec=codec,
        )
    number, times, stamp, repeats = shutter.schedule(duration, rng)
    if not len(number):
        raise CaptureError(
            f"a record_film of {duration} s at {shutter.rate} frames/s has no frames",
            code="no-frames",
            where=path.name,
            action="Choose a longer duration or a higher rate",
            duration=duration,
            rate=shutter.rate,
        )
    fourcc = cv2.VideoWriter.fourcc(*codec)
    renderer = Renderer(camera, optics, rng)
    scenes: list[Scene] = []
    seen: list[tuple[Float, Float]] = []
    with replacing(path) as part, _writer(path, part, fourcc, shutter.rate, camera.size) as writer:
        for time, again in zip(times, repeats, strict=True):
            if not again:
                scene, instants = expose(scene_at, camera, float(time), optics)
                picture = renderer.shoot(scene, instants, float(time))
            writer.write(picture.image)
            scenes.append(scene.moved(body=None))  # which would fill the memory
            seen.append((picture.corners, picture.visible))
            if len(scene.patches) != len(scenes[0].patches) or not scene.patches:
                raise CaptureError(
                    f"the scene has {len(scene.patches)} patches at {time:g} s, and"
                    f" {len(scenes[0].patches)} in the first frame; a record_film needs the same patches"
                    " in all frames, at least one",
                    code="patches-differ",
                    where=path.name,
                )
    lines = (f"{k},{t:.9f}" for k, t in enumerate(stamp))
    write_text(path.with_suffix(".csv"), "\n".join(["frame,time", *lines]) + "\n")
    truth = _truth(scenes, seen, (number, times, stamp, repeats))
    save_truth(path.with_suffix(".npz"), truth)
    return truth


@contextmanager
def _writer(
    path: Path, part: Path, fourcc: int, rate: float, size: tuple[int, int]
) -> Iterator[cv2.VideoWriter]:
    """A video that is written to `part`, closed in any case."""
    writer = cv2.VideoWriter(str(part), cv2.CAP_FFMPEG, fourcc, rate, size, False)
    try:
        if not writer.isOpened():
            raise StorageError(
                "the video cannot be written",
                code="file-not-writable",
                where=path,
                action="Check that the folder exists and that the file name ends in .mkv",
            )
        yield writer
    finally:
        writer.release()


def _truth(
    scenes: list[Scene],
    seen: list[tuple[Float, Float]],
    schedule: tuple[Int, Float, Float, Bool],
) -> FilmTruth:
    m = len(scenes[0].patches)
    return FilmTruth(
        *schedule,
        np.array([s.led is not None and s.led.on for s in scenes]),
        np.array([p.number for p in scenes[0].patches], int),
        np.array([p.center for s in scenes for p in s.patches]).reshape(-1, m, 3),
        np.array([p.corners for s in scenes for p in s.patches]).reshape(-1, m, 4, 3),
        np.array([corners for corners, _ in seen]).reshape(-1, m, 4, 2),
        np.array([visible for _, visible in seen]).reshape(-1, m),
    )


def save_truth(path: Path, truth: FilmTruth) -> None:
    """As NPZ, whole or not at all. Raises StorageError."""
    with replacing(path) as part:
        np.savez_compressed(part, **{f.name: getattr(truth, f.name) for f in fields(FilmTruth)})


def load_truth(path: Path) -> FilmTruth:
    """What `save_truth` wrote. Raises StorageError for other files."""
    try:
        with np.load(path, allow_pickle=False) as data:
            return FilmTruth(**{f.name: data[f.name] for f in fields(FilmTruth)})
    except (OSError, KeyError, ValueError) as problem:
        raise StorageError(
            f"is not a table of the truth about a record_film ({problem})",
            code="file-unreadable",
            where=path,
        ) from None
