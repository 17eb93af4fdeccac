"""Color scales, color bars, and the colors on the screen."""

import json
import re
import struct

import numpy as np
import pytest

from defsense_fab.studio.workbench.colors import (
    ColorScale,
    color_bar,
    round_up,
    tick_labels,
    unlit_mesh,
)


def test_ends_of_ranges_have_few_digits():
    assert [round_up(x) for x in (0.0123, 6.2, 8.0, 98.0, 2.0001e-4)] == pytest.approx(
        [0.016, 8.0, 8.0, 100.0, 3e-4]
    )


def test_symmetric_scale_is_gray_at_zero_and_keeps_the_colors_of_its_ends():
    scale = ColorScale.symmetric(5.7)
    assert (scale.low, scale.high) == (-6.0, 6.0)
    low, zero, high, beyond, unknown = scale.colors(np.array([-6.0, 0.0, 6.0, 60.0, np.nan]))
    assert low[2] > low[0]  # blue
    assert high[0] > high[2]  # orange
    assert np.ptp(zero) == 0  # gray
    np.testing.assert_array_equal(high, beyond)
    assert np.ptp(unknown) == 0
    assert abs(unknown[0] - zero[0]) > 0.2


def test_color_bar_has_the_numbers_of_its_colors():
    scale = ColorScale.symmetric(7.0)
    assert tick_labels(scale) == ["\u22128", "\u22124", "0", "4", "8"]
    bar = color_bar(scale, "A < B", "percent strain", "of this state")
    assert re.findall(r'text-anchor="middle">([^<]*)<', bar) == tick_labels(scale)
    assert "A &lt; B</b> (percent strain)" in bar
    fills = re.findall(r'fill="rgb\((\d+),(\d+),(\d+)\)"', bar)
    assert len(fills) == 64
    expected = np.rint(255 * scale.colors(np.array([-8 + 8 / 64, 8 - 8 / 64]))).astype(int)
    np.testing.assert_array_equal(np.array([fills[0], fills[-1]], int), expected)
    assert 'fill="currentColor"' in bar  # light or dark as the page is
    labels = tick_labels(ColorScale.from_zero(1.2e-3))
    assert labels == ["0", "0.0003", "0.0006", "0.0009", "0.0012"]


def test_nearly_equal_gains_get_a_scale_from_zero():
    assert ColorScale.for_gains(np.array([9.9, np.nan, 10.0])).low == 0.0
    scale = ColorScale.for_gains(np.array([-1.0, 2.0, 10.0]))
    assert (scale.low, scale.high) == (0.0, 10.0)
    assert ColorScale.for_gains(np.array([6.0, 10.0])).low == 6.0
    assert ColorScale.for_gains(np.array([np.nan])).high > 0


def tone_mapping(linear):
    """ACESFilmicToneMapping of three.js, implemented independently."""
    into = [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
    out = [
        [1.60475, -0.53108, -0.07367],
        [-0.10208, 1.10813, -0.00605],
        [-0.00327, -0.07276, 1.07602],
    ]
    v = linear / 0.6 @ np.array(into).T
    v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
    return np.clip(v @ np.array(out).T, 0, 1)


def test_the_screen_shows_the_colors_of_the_bar():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1]])
    colors = ColorScale.symmetric(1.0).colors(np.array([-0.9, -0.3, 0.2, 0.8]))
    triangles = np.array([[0, 1, 2], [1, 2, 3]])
    glb = unlit_mesh(points, triangles, colors)
    magic, version, size, length, kind = struct.unpack("<4sIII4s", glb[:20])
    assert (magic, version, size, kind) == (b"glTF", 2, len(glb), b"JSON")
    document, body = json.loads(glb[20 : 20 + length]), glb[28 + length :]
    assert document["extensionsUsed"] == ["KHR_materials_unlit"]
    arrays = [
        np.frombuffer(body, kind, a["count"] * n, document["bufferViews"][k]["byteOffset"])
        for k, (a, kind, n) in enumerate(
            zip(document["accessors"], ("<f4", "<f4", "<u4"), (3, 3, 1), strict=True)
        )
    ]
    np.testing.assert_allclose(arrays[0].reshape(-1, 3), points)
    np.testing.assert_array_equal(arrays[2].reshape(-1, 3), triangles)
    shown = tone_mapping(arrays[1].reshape(-1, 3).astype(float))
    screen = np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(screen, colors, atol=0.02)
