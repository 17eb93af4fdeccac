"""Recorded images: video files, folders of images, numbered images."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ...core.arrays import Float
from ...core.errors import CaptureError
from ..tags.tag_detection import Image

_IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm")
_LATE = 1.5  # periods without a frame that are a gap


@dataclass(frozen=True)
class Timing:
    """What the time stamps of t frames say: their median `period`, s; how many frames are `missing`
    in gaps, how many came twice with one stamp (`repeated`), and how often time went back."""

    period: float
    missing: int
    repeated: int
    back: int


def timing(time: Float) -> Timing:
    """Of stamps (t,) s."""
    step = np.diff(time)
    if not len(step) or not (step > 0).any():
        return Timing(0.0, 0, int((step == 0).sum()), int((step < 0).sum()))
    period = float(np.median(step[step > 0]))
    gaps = step[step > _LATE * period]
    missing = int((np.round(gaps / period) - 1).sum())
    return Timing(period, missing, int((step == 0).sum()), int((step < 0).sum()))


class Video:
    """The frames of a file, one after the other; the times of images come from `rate`, Hz."""

    def __init__(self, path: Path, rate: float | None = None) -> None:
        """Raises CaptureError for what is no video, and for images without a rate."""
        self.path, self._rate = path, rate
        self._files: list[Path] = []
        self._capture: cv2.VideoCapture | None = None
        pattern = "%" in path.name
        if path.is_dir():
            images = (p for p in path.iterdir() if p.suffix.lower() in _IMAGES)
            self._files = sorted(images, key=_by_number)
            if not self._files:
                raise CaptureError(
                    f"{path}: the folder has no images ({', '.join(_IMAGES)})",
                    code="images-missing",
                )
        elif not path.exists() and not pattern:
            raise CaptureError(f"{path}: there is no such file", code="file-not-found")
        if (self._files or pattern) and rate is None:
            raise CaptureError(
                f"{path}: images have no time stamps; give the frames per second at which they were"
                " taken with --rate",
                code="frame-rate-missing",
            )
        if self._files:
            self.expected = len(self._files)
            first = _image(self._files[0])
            self.size = first.shape[1], first.shape[0]
            return
        quiet()
        self._capture = cv2.VideoCapture(str(path))
        width, height = (
            int(self._capture.get(k)) for k in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        count = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        if not self._capture.isOpened() or min(width, height) < 1:
            raise CaptureError(
                f"{path}: cannot be opened as a video; check that it is one and is not damaged",
                code="video-unreadable",
            )
        self.size = width, height
        #: Frames that the file says it has; 0 where it does not say.
        self.expected = int(count) if np.isfinite(count) and 0 < count < 1e9 else 0

    def frames(self) -> Iterator[tuple[int, float, Image]]:
        """Number, time s and image of each frame that can be read."""
        if self._files:
            for k, file in enumerate(self._files):
                yield k, k / (self._rate or 1.0), _image(file)
            return
        assert self._capture is not None
        k = 0
        while True:
            there, image = self._capture.read()
            if not there:
                return
            time = self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
            yield k, k / self._rate if self._rate else time, np.asarray(image, np.uint8)
            k += 1

    def close(self) -> None:
        """Let go of the file."""
        if self._capture is not None:
            self._capture.release()


def _by_number(path: Path) -> tuple[list[str | int], str]:
    """For a9 to come before a10."""
    parts = re.split(r"(\d+)", path.name)
    return [int(p) if k % 2 else p for k, p in enumerate(parts)], path.name


def _image(path: Path) -> Image:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise CaptureError(
            f"{path}: cannot be read as an image; check that it is one and is not damaged",
            code="image-unreadable",
            file=path.name,
        )
    return np.asarray(image, np.uint8)


def quiet() -> None:
    """OpenCV and FFmpeg write to standard error by themselves; errors are told in our words."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
