"""The LED is located where it blinks, and nowhere else."""

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


def find_led(frames):
    """Return the position of the LED in images, or None."""
    detector = LedDetector()
    places = (detector.add(image) for image in frames)
    return next((place for place in places if place is not None), None)


def blinking(radius, rise):
    return lambda k, x, y: rise * (int(k / STAY) % 2) * disc(x, y, (101.3, 44.8), radius)


@pytest.mark.parametrize(
    ("radius", "rise", "level"), [(1.5, 100, 100), (1.5, 150, 20), (3, 60, 190), (7, 200, 40)]
)
def test_led_is_located(radius, rise, level):
    place = find_led(images(200, blinking(radius, rise), level=level))
    assert place == pytest.approx([101.3, 44.8], abs=4)


def test_led_is_located_in_color_images():
    place = find_led(np.dstack([image] * 3) for image in images(150, blinking(3, 120)))
    assert place == pytest.approx([101.3, 44.8], abs=4)


def test_led_that_starts_to_blink_late_is_located():
    draw = blinking(3, 120)
    place = find_led(images(700, lambda k, x, y: draw(k, x, y) * (k > 300), size=(48, 160)))
    assert place == pytest.approx([101.3, 44.8], abs=4)


@pytest.mark.parametrize(
    "draw",
    [
        lambda k, x, y: 0 * x,
        lambda k, x, y: 80.0 * disc(x, y, (80 + 40 * np.sin(k / 7), 40), 8),  # a tag that moves
        lambda k, x, y: 20.0 * np.sin(2 * np.pi * k / 23) + 0 * x,  # light that flickers
        lambda k, x, y: 100.0 * (k % 3 == 0) * disc(x, y, (80, 40), 4),
        lambda k, x, y: 100.0 * (k > 100) * disc(x, y, (80, 40), 4),
    ],
)
def test_other_changes_are_not_taken_for_the_led(draw):
    assert find_led(images(200, draw)) is None


def test_unsuitable_images_are_rejected():
    detector = LedDetector()
    assert detector.add(np.zeros((64, 64), np.uint8)) is None
    with raises(CaptureError, "image-size-changed", frame=1, size=(64, 48)):
        detector.add(np.zeros((48, 64), np.uint8))
    with raises(CaptureError, "image-too-small"):
        LedDetector().add(np.zeros((8, 8), np.uint8))
