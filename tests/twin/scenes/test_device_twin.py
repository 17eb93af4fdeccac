"""The moving twin of a device: its skin and the patches glued to it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from defsense_fab.core.errors import CaptureError
from defsense_fab.core.mesh import Surface
from defsense_fab.twin.scenes.device_motion import Ramp
from defsense_fab.twin.scenes.device_twin import DeviceTwin, RigidMotion, blend
from defsense_fab.twin.scenes.scene import Ball, Patch, Scene
from tests.support.errors import raises
from tests.twin.views import tag, turn

LEVELS = np.array([0.25, 0.5, 0.75, 1.0])


def make_bar(count=31):
    """Return a closed bar along x of 4 strips."""
    ring = np.array([[-10, -5], [10, -5], [10, 5], [-10, 5]], float)
    x = np.linspace(0, 100, count)
    vertices = np.array([[a, y, z] for a in x for y, z in ring])
    faces = []
    for i in range(count - 1):
        for j in range(4):
            a, b = 4 * i + j, 4 * i + (j + 1) % 4
            faces += [(a, a + 4, b), (b, a + 4, b + 4)]
    faces += [(0, 1, 2), (0, 2, 3)]
    k = len(vertices) - 4
    faces += [(k, k + 2, k + 1), (k, k + 3, k + 2)]
    surface = Surface(vertices, np.array(faces))
    return surface if surface.volume > 0 else Surface(vertices, surface.faces[:, ::-1].copy())


def bend(p, angle):
    """Bend points (..., 3) mm of the bar to an arc of an angle."""
    radius = 100 / angle
    a, r = p[..., 0] / radius, radius - p[..., 2]
    return np.stack([r * np.sin(a), p[..., 1], radius - r * np.cos(a)], axis=-1)


BAR = make_bar()
PATCHES = tuple(
    Patch(k, tag(k), np.array([x, 0, 5.1]), turn(z=0.3 * k), 12.0)
    for k, x in enumerate((15.0, 50.0, 85.0))
)
FIELDS = np.stack(
    [bend(BAR.vertices, 0.8 * a) - BAR.vertices for a in LEVELS]
    + [np.roll(BAR.vertices, 1, axis=1) * 0.01 * a for a in (1, 2)]
)
TWIN = DeviceTwin(BAR, FIELDS, PATCHES)
UNIT = np.eye(6)


def test_patches_are_where_they_were_glued_at_rest():
    body, patches = TWIN.deform(np.zeros(6))
    assert (body.vertices == BAR.vertices).all()
    for moved, patch in zip(patches, PATCHES, strict=True):
        assert moved.center == pytest.approx(patch.center)
        assert moved.axes == pytest.approx(patch.axes)
        assert moved.number == patch.number


def test_patches_bend_with_the_bar():
    _, patches = TWIN.deform(UNIT[3])
    for moved, patch in zip(patches, PATCHES, strict=True):
        assert moved.center == pytest.approx(bend(patch.center, 0.8), abs=0.05)
        a = 0.8 * patch.center[0] / 100
        assert moved.axes == pytest.approx(turn(y=-a) @ patch.axes, abs=0.01)


@settings(max_examples=10, deadline=None)
@given(*[st.floats(-3, 3)] * 3, *[st.floats(-200, 200)] * 3)
def test_rigid_motion_moves_patches_rigidly(a, b, c, x, y, z):
    held = RigidMotion(turn(a, b, c), np.array([x, y, z]))
    field = BAR.vertices @ held.rotation.T + held.translation - BAR.vertices
    as_state = DeviceTwin(BAR, field[None], PATCHES).deform(np.ones(1))
    as_held = TWIN.deform(np.zeros(6), held)
    for body, patches in (as_state, as_held):
        assert body.vertices == pytest.approx(BAR.vertices + field, abs=1e-9)
        for moved, patch in zip(patches, PATCHES, strict=True):
            expected = held.rotation @ patch.center + held.translation
            assert moved.center == pytest.approx(expected, abs=1e-6)
            assert moved.axes == pytest.approx(held.rotation @ patch.axes, abs=1e-8)


def test_scene_keeps_its_surroundings():
    surroundings = Scene(occluders=(Ball(np.zeros(3), 5.0),), skin=70.0)
    scene = TWIN.scene(UNIT[0], surroundings=surroundings)
    assert scene.skin == 70.0
    assert len(scene.occluders) == 1
    assert len(scene.patches) == 3
    assert scene.body is not None


def test_blend_of_cord_paths_is_their_weighted_sum():
    paths = np.random.default_rng(0).normal(size=(6, 20, 3))
    weights = np.array([0, 0.5, 0, 0.2, 0, 0.1])
    assert blend(paths, weights) == pytest.approx(np.einsum("s,spi->pi", weights, paths))


def test_ramp_interpolates_bending_far_better_than_a_straight_line():
    ramp = Ramp("bend", LEVELS, np.arange(4))
    interpolated = blend(FIELDS[:4], ramp.weights(np.array(0.625)))
    exact = bend(BAR.vertices, 0.8 * 0.625) - BAR.vertices
    straight = 0.625 * FIELDS[3]
    assert np.abs(interpolated - exact).max() < 0.05
    assert np.abs(straight - exact).max() > 2


def test_displacements_of_other_vertices_are_rejected():
    with raises(CaptureError, "displacements-do-not-fit"):
        DeviceTwin(BAR, FIELDS[:, 1:], PATCHES)
