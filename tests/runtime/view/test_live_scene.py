"""Colors of cords and markers, tube meshes of cords, and points that follow the surface."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.runtime.view.live_scene import (
    BODY_COLORS,
    cord_color,
    marker_colors,
    place_camera,
    skinning_weights,
    tube_faces,
    tube_vertices,
)
from tests.runtime.bars import bent


def test_cords_are_blue_where_shorter_red_where_longer_grey_where_lost():
    assert cord_color(0.0, -0.1, 0.2) == (225, 225, 225)
    r, _, b = cord_color(0.2, -0.1, 0.2)
    assert r > 2 * b
    r, _, b = cord_color(-0.1, -0.1, 0.2)
    assert b > 2 * r
    assert cord_color(0.4, -0.1, 0.2) == cord_color(0.2, -0.1, 0.2)
    assert cord_color(float("nan"), -0.1, 0.2) == (90, 90, 90)


def test_markers_turn_red_as_their_intervals_widen():
    sure, wide, unknown = marker_colors(np.array([0.5, 3.0, np.nan]), 1.0)
    assert sure[1] > sure[0]
    assert wide[0] > wide[1]
    assert (unknown == wide).all()


def test_every_quality_has_a_color():
    assert set(BODY_COLORS) == set(Quality)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rings_lie_across_the_path_at_the_radius(axis):
    t = np.linspace(0, 3, 40)
    path = np.roll(np.stack([20 * t, 5 * np.sin(t), 0 * t], axis=1), axis, axis=1)
    rings = tube_vertices(path, 1.5).reshape(40, 8, 3)
    assert np.linalg.norm(rings - path[:, None], axis=2) == pytest.approx(1.5)
    along = np.gradient(path, axis=0)
    assert np.einsum("pri,pi->pr", rings - path[:, None], along) == pytest.approx(0, abs=1e-9)
    # No ring is rotated relative to the one before.
    assert np.linalg.norm(np.diff(rings, axis=0), axis=2).max() < 3


def test_faces_join_neighbouring_rings():
    faces = tube_faces(5)
    assert faces.shape == (2 * 8 * 4, 3)
    assert faces.min() == 0
    assert faces.max() == 39
    assert np.ptp(faces, axis=1).max() < 16


def skin(rng):
    p = rng.uniform(-1, 1, (1500, 3))
    p /= np.abs(p).max(axis=1, keepdims=True)
    return p * [75, 15, 15] + [75, 0, 0]


def test_affine_movement_is_carried_exactly():
    rng = np.random.default_rng(0)
    vertices = skin(rng)
    inside = rng.uniform([5, -10, -10], [145, 10, 10], (30, 3))
    weights = skinning_weights(inside, vertices)
    assert np.asarray(weights.sum(axis=1)).ravel() == pytest.approx(1)
    R = Rotation.from_rotvec([0.4, -0.8, 0.2]).as_matrix() @ np.diag([1.1, 0.95, 1.0])
    move = lambda p: p @ R.T + [3, 4, -5] - p  # noqa: E731
    assert weights @ move(vertices) == pytest.approx(move(inside), abs=1e-4)


def test_bend_is_carried_within_a_tenth_of_the_motion():
    rng = np.random.default_rng(1)
    vertices = skin(rng)
    inside = rng.uniform([5, -8, -8], [145, 8, 8], (30, 3))
    off = skinning_weights(inside, vertices) @ bent(vertices, 0.5) - bent(inside, 0.5)
    assert np.linalg.norm(off, axis=1).max() < 0.1 * np.abs(bent(inside, 0.5)).max()


class RacingCamera:
    """A viser camera whose browser reports what it shows between two changes.

    Viser sends a changed position with the point moved as far, and no point that equals the one
    reported last.
    """

    def __init__(self, reported):
        self._position, self._look_at = np.full(3, 3.0), np.zeros(3)
        self._reported, self.shown = reported, {}

    @property
    def position(self):
        return self._position

    @position.setter
    def position(self, value):
        moved = np.asarray(value) - self._position
        self.shown["position"] = self._position = np.asarray(value)
        self.look_at = self._look_at + moved
        self._look_at = self._reported

    @property
    def look_at(self):
        return self._look_at

    @look_at.setter
    def look_at(self, value):
        if not np.allclose(self._look_at, value):
            self.shown["look_at"] = self._look_at = np.asarray(value)


def test_a_camera_looks_at_its_point_when_the_browser_reports_late():
    """The browser reports the point of the first call during the second one."""
    position, target = np.array([145.0, -155.0, 85.0]), np.array([75.0, 0.0, 0.0])
    first = RacingCamera(np.zeros(3))
    place_camera(SimpleNamespace(camera=first), position, target, np.array([0.0, 0.0, 1.0]))
    assert first.up_direction == (0.0, 0.0, 1.0)
    second = RacingCamera(first.shown["look_at"])
    place_camera(SimpleNamespace(camera=second), position, target)
    assert second.shown["position"] == pytest.approx(position)
    assert second.shown["look_at"] == pytest.approx(target, abs=0.5)
    line, shown = target - position, second.shown["look_at"] - position
    assert np.cross(line, shown) == pytest.approx(np.zeros(3), abs=1e-6 * (line @ line))
