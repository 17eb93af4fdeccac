"""Colours of numbers, and the bar that tells them."""

import json
import re
import struct

import numpy as np
import pytest

from defsense_fab.studio.inside.color_scale import color_bar, tick_words
from defsense_fab.studio.inside.color_scale import rounded_up, Scale
from defsense_fab.studio.inside.section_quantities import LOOKS, NEXT_CORD, reach_words
from defsense_fab.studio.inside.section_view import unlit_mesh


def test_ends_of_ranges_are_good_to_read():
    assert [rounded_up(x) for x in (0.0123, 6.2, 8.0, 98.0, 2.0001e-4)] == pytest.approx(
        [0.016, 8.0, 8.0, 100.0, 3e-4]
    )


def test_stretches_are_symmetric_about_none_and_ends_keep_their_colour():
    scale = Scale.about_zero(5.7)
    assert (scale.low, scale.high) == (-6.0, 6.0)
    low, none, high, beyond, unknown = scale.colors(np.array([-6.0, 0.0, 6.0, 60.0, np.nan]))
    assert low[2] > low[0]  # blue
    assert high[0] > high[2]  # orange
    assert np.ptp(none) == 0  # grey
    np.testing.assert_array_equal(high, beyond)
    assert np.ptp(unknown) == 0
    assert abs(unknown[0] - none[0]) > 0.2


def test_the_bar_has_the_numbers_of_its_colours():
    scale = Scale.about_zero(7.0)
    assert tick_words(scale) == ["\u22128", "\u22124", "0", "4", "8"]
    told = color_bar(scale, "A < B", "percent strain", "of this state")
    assert re.findall(r'text-anchor="middle">([^<]*)<', told) == tick_words(scale)
    assert "A &lt; B</b> (percent strain)" in told
    fills = re.findall(r'fill="rgb\((\d+),(\d+),(\d+)\)"', told)
    assert len(fills) == 64
    expected = np.rint(255 * scale.colors(np.array([-8 + 8 / 64, 8 - 8 / 64]))).astype(int)
    np.testing.assert_array_equal(np.array([fills[0], fills[-1]], int), expected)
    assert 'fill="currentColor"' in told  # light or dark as the page is
    assert tick_words(Scale.spread(1.2e-3)) == ["0", "0.0003", "0.0006", "0.0009", "0.0012"]


def test_small_differences_of_what_helps_do_not_look_large():
    assert Scale.gain(np.array([9.9, np.nan, 10.0])).low == 0.0
    scale = Scale.gain(np.array([-1.0, 2.0, 10.0]))
    assert (scale.low, scale.high) == (0.0, 10.0)
    assert Scale.gain(np.array([6.0, 10.0])).low == 6.0
    assert Scale.gain(np.array([np.nan])).high > 0


def test_stretches_are_told_as_percent_strain_and_variances_as_they_are():
    along, *_, variance, _ = LOOKS
    np.testing.assert_allclose(along.numbers(np.array([1.0, 1.25, 0.9])), [0, 25, -10])
    assert (along.unit, along.scale(0.055).high) == ("percent strain", pytest.approx(6.0))
    np.testing.assert_array_equal(variance.numbers(np.array([0.004])), [0.004])
    assert "no unit" in variance.unit
    assert NEXT_CORD.unit == "mm"
    assert reach_words(along, np.array([-1.0, 2.5])) == "in this section \u22121.0 to +2.5 %"
    assert reach_words(NEXT_CORD, np.array([np.nan])) == "no number is known here"


def curve(linear):
    """Three.js' ACESFilmicToneMapping, written down once more."""
    into = [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
    out = [
        [1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602],
    ]  # fmt: skip
    v = linear / 0.6 @ np.array(into).T
    v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
    return np.clip(v @ np.array(out).T, 0, 1)


def test_the_page_shows_the_colours_of_the_bar():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1]])
    colors = Scale.about_zero(1.0).colors(np.array([-0.9, -0.3, 0.2, 0.8]))
    triangles = np.array([[0, 1, 2], [1, 2, 3]])
    told = unlit_mesh(points, triangles, colors)
    magic, version, whole, length, kind = struct.unpack("<4sIII4s", told[:20])
    assert (magic, version, whole, kind) == (b"glTF", 2, len(told), b"JSON")
    document, body = json.loads(told[20 : 20 + length]), told[28 + length :]
    assert document["extensionsUsed"] == ["KHR_materials_unlit"]
    arrays = [
        np.frombuffer(body, kind, a["count"] * n, document["bufferViews"][k]["byteOffset"])
        for k, (a, kind, n) in enumerate(
            zip(document["accessors"], ("<f4", "<f4", "<u4"), (3, 3, 1), strict=True)
        )
    ]
    np.testing.assert_allclose(arrays[0].reshape(-1, 3), points)
    np.testing.assert_array_equal(arrays[2].reshape(-1, 3), triangles)
    shown = curve(arrays[1].reshape(-1, 3).astype(float))
    screen = np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(screen, colors, atol=0.02)
