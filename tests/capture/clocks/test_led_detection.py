"""The LED in images: found where it blinks, and nowhere else."""

import numpy as np
import pytest

from defsense_fab.capture.clocks.led_detection import LedDetector
from defsense_fab.core.errors import CaptureError
from tests.support.errors import raises

STAY = 11.49


def images(count, draw, size=(96, 160), level=100, noise=2.0, seed=0):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: size[0], : size[1]]
    for k in range(count):
        image = level + draw(k, x, y) + noise * rng.standard_normal(size)
        yield np.clip(image, 0, 255).astype(np.uint8)


def disc(x, y, at, radius):
    return np.clip(radius + 0.5 - np.hypot(x - at[0], y - at[1]), 0, 1)


def watched(count, draw, stay=STAY, **kw):
    watch = LedDetector(stay)
    for image in images(count, draw, **kw):
        watch.add(image)
    return watch.trace()


def blinking(radius, rise):
    return lambda k, x, y: rise * (int(k / STAY) % 2) * disc(x, y, (101.3, 44.8), radius)


@pytest.mark.parametrize(
    ("radius", "rise", "level"), [(1.5, 100, 100), (1.5, 150, 20), (3, 60, 190), (7, 200, 40)]
)
def test_an_led_is_found(radius, rise, level):
    trace = watched(200, blinking(radius, rise), level=level)
    assert trace.place == pytest.approx([101.3, 44.8], abs=4)
    assert len(trace.brightness) == 200
    on = np.array([int(k / STAY) % 2 for k in range(200)], bool)
    assert trace.brightness[on].min() > trace.brightness[~on].max()
    assert trace.contrast > 8 * trace.noise


def test_color_images_and_any_pace():
    watch = LedDetector()
    for image in images(150, blinking(3, 120)):
        watch.add(np.dstack([image] * 3))
    assert watch.trace().place == pytest.approx([101.3, 44.8], abs=4)


def test_the_led_is_traced_from_the_first_kept_frame():
    trace = watched(700, blinking(3, 120), size=(48, 160))
    assert len(trace.brightness) == 700
    assert np.isfinite(trace.brightness).all()


@pytest.mark.parametrize(
    "draw",
    [
        lambda k, x, y: 0 * x,
        lambda k, x, y: 80.0 * disc(x, y, (80 + 40 * np.sin(k / 7), 40), 8),  # a tag that moves
        lambda k, x, y: 20.0 * np.sin(2 * np.pi * k / 23) + 0 * x,  # light that flickers
        lambda k, x, y: 100.0 * (k % 3 == 0) * disc(x, y, (80, 40), 4),
        lambda k, x, y: 100.0 * (int(k / 25) % 2) * disc(x, y, (80, 40), 4),  # another lamp
        lambda k, x, y: 100.0 * (k > 100) * disc(x, y, (80, 40), 4),
    ],
)
def test_other_changes_are_not_taken_for_the_led(draw):
    assert watched(200, draw) is None


def test_unsuitable_images_are_refused():
    watch = LedDetector()
    assert watch.trace() is None
    watch.add(np.zeros((64, 64), np.uint8))
    with raises(CaptureError, "image-size-changed", frame=1, size=(64, 48)):
        watch.add(np.zeros((48, 64), np.uint8))
    with raises(CaptureError, "image-too-small"):
        LedDetector().add(np.zeros((8, 8), np.uint8))
    with raises(CaptureError, "led-too-fast"):
        LedDetector(1.0)
