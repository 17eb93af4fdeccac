"""Cameras that are plugged in: whether each gives a picture."""

from __future__ import annotations

import sys
from pathlib import Path

from .finding import Finding, judged
from .isolated import call

_FOR = "recording a device with cameras"
_MOST = 4  # cameras that are tried where the system does not list them
_WAIT = 5.0  # s for a picture


def check_cameras(seconds: float, pictures: Path | None) -> list[Finding]:
    """Each camera is opened, and a picture of it put into `pictures` where that is given."""
    found = cameras()
    if not found:
        return [judged("cameras", "camera", False, "none is plugged in", needed_for=_FOR)]
    answers = {name: call(__name__, "look", name, str(pictures or ""), seconds=seconds)
               for name in found}  # fmt: skip
    if sys.platform != "linux":  # numbers that were guessed
        answers = {name: a for name, a in answers.items() if not a.trouble} or {"0": answers["0"]}
    return [
        judged("cameras", f"camera {name}", not a.trouble,
               a.trouble or a.value, needed_for=_FOR)
        for name, a in answers.items()
    ]  # fmt: skip


def cameras() -> list[str]:
    """Their devices. On Linux a camera has several, of which the first gives pictures."""
    if sys.platform != "linux":
        return [str(number) for number in range(_MOST)]
    listed = sorted(Path("/sys/class/video4linux").glob("video*/index"))
    return [f"/dev/{i.parent.name}" for i in listed if i.read_text("ascii").strip() == "0"]


def look(address: str, pictures: str = "") -> str:
    """Take a picture; its size, and where it was written. Raises CaptureError, and StorageError
    where it cannot be written."""
    import cv2

    from ...capture.cameras.image_sources import Webcam
    from ...core.errors import CaptureError, StorageError

    camera = Webcam(address)
    camera.start()
    try:
        taken = camera.read(_WAIT)
    finally:
        camera.close()
    if taken is None:
        raise CaptureError(f"camera {address}: gives no picture")
    told = "{} x {} pixels".format(*camera.size)
    if not pictures:
        return told
    path = Path(pictures) / f"camera-{Path(address).stem}.png"
    if not cv2.imwrite(str(path), taken[0]):
        raise StorageError(f"{path}: cannot be written; check its permissions and the disk")
    return f"{told}, picture in {path}"
