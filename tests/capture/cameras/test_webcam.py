"""Cameras that are plugged in, with a fake of the driver's capture."""

import threading

import numpy as np
import pytest

from defsense_fab.capture.cameras import image_sources as webcams
from defsense_fab.capture.cameras.image_sources import Webcam
from defsense_fab.core.errors import CaptureError
from tests.support.errors import raises


class Capture:
    """A fake `cv2.VideoCapture`; `grab` waits for `resume` while `hangs` is set."""

    def __init__(self, opened: bool = True, image: bool = True) -> None:
        self.opened, self.image = opened, image
        self.hangs, self.inside, self.resume = False, threading.Event(), threading.Event()
        self.released, self.released_under_grab = 0, False

    def isOpened(self) -> bool:  # noqa: N802
        return self.opened

    def set(self, option: int, value: float) -> bool:
        return True

    def read(self):
        return self.image, np.zeros((48, 64, 3), np.uint8)

    def grab(self) -> bool:
        if self.hangs:
            self.inside.set()
            self.resume.wait(120)
            self.released_under_grab |= self.released > 0
        return True

    def retrieve(self):
        threading.Event().wait(0.005)
        return self.read()

    def release(self) -> None:
        self.released += 1


def camera(monkeypatch, capture):
    monkeypatch.setattr(webcams.cv2, "VideoCapture", lambda index, back_end: capture)
    return Webcam("0")


def test_frames_arrive_until_the_camera_is_closed(monkeypatch):
    capture = Capture()
    source = camera(monkeypatch, capture)
    source.start()
    assert source.size == (64, 48)
    image, _ = source.read(5)
    assert image.shape == (48, 64, 3)
    source.close()
    source.close()
    assert capture.released == 1


def test_camera_is_not_released_under_its_thread(monkeypatch):
    monkeypatch.setattr(webcams, "THREAD_JOIN_TIMEOUT_S", 0.1, raising=False)
    capture = Capture()
    source = camera(monkeypatch, capture)
    join = source._thread.join
    monkeypatch.setattr(source._thread, "join", lambda timeout=None: join(0.1))
    source.start()
    capture.hangs = True
    assert capture.inside.wait(120)
    source.close()
    assert not capture.released
    capture.resume.set()
    join(120)
    assert capture.released == 1
    assert not capture.released_under_grab


@pytest.mark.parametrize(
    ("capture", "code"), [(Capture(opened=False), "camera-unavailable"),
                          (Capture(image=False), "camera-gives-no-image")],
)  # fmt: skip
def test_camera_that_does_not_start_is_released(monkeypatch, capture, code):
    source = camera(monkeypatch, capture)
    with raises(CaptureError, code, camera="0"):
        source.start()
    source.close()
    assert capture.released
