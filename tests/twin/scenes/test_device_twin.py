"""The moving twin of a device: skin, what is glued to it, and its way through the poses."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from defsense_fab.core.errors import CaptureError
from defsense_fab.core.mesh import Surface
from defsense_fab.twin.scenes.device_motion import (
    Motion,
    Ramp,
    script_motion,
    draw_sway,
    draw_motion,
)
from defsense_fab.twin.scenes.device_twin import DeviceTwin, RigidMotion, blend
from defsense_fab.twin.scenes.scene import Ball, Patch, Scene
from tests.errors import raises
from tests.twin.views import tag, turn

LEVELS = np.array([0.25, 0.5, 0.75, 1.0])
RAMPS = (
    Ramp("bend", LEVELS, np.array([0, 1, 2, 3])),
    Ramp("twist", LEVELS[1::2], np.array([4, 5])),
)


def bar(count=31):
    """A closed bar along x of 4 strips."""
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


def bent(p, angle):
    radius = 100 / angle
    a, r = p[..., 0] / radius, radius - p[..., 2]
    return np.stack([r * np.sin(a), p[..., 1], radius - r * np.cos(a)], axis=-1)


BAR = bar()
SEATS = tuple(
    Patch(k, tag(k), np.array([x, 0, 5.1]), turn(z=0.3 * k), 12.0)
    for k, x in enumerate((15.0, 50.0, 85.0))
)
FIELDS = np.stack(
    [bent(BAR.vertices, 0.8 * a) - BAR.vertices for a in LEVELS]
    + [np.roll(BAR.vertices, 1, axis=1) * 0.01 * a for a in (1, 2)]
)
TWIN = DeviceTwin(BAR, FIELDS, SEATS)
UNIT = np.eye(6)


def test_at_rest_all_is_where_it_was_glued():
    body, patches = TWIN.at(np.zeros(6))
    assert (body.vertices == BAR.vertices).all()
    for patch, seat in zip(patches, SEATS, strict=True):
        assert patch.center == pytest.approx(seat.center)
        assert patch.axes == pytest.approx(seat.axes)
        assert patch.number == seat.number


def test_patches_bend_with_the_bar():
    _, patches = TWIN.at(UNIT[3])
    for patch, seat in zip(patches, SEATS, strict=True):
        assert patch.center == pytest.approx(bent(seat.center, 0.8), abs=0.05)
        a = 0.8 * seat.center[0] / 100
        assert patch.axes == pytest.approx(turn(y=-a) @ seat.axes, abs=0.01)


@settings(max_examples=10, deadline=None)
@given(*[st.floats(-3, 3)] * 3, *[st.floats(-200, 200)] * 3)
def test_a_rigid_motion_moves_patches_rigidly(a, b, c, x, y, z):
    held = RigidMotion(turn(a, b, c), np.array([x, y, z]))
    field = BAR.vertices @ held.turn.T + held.shift - BAR.vertices
    as_state = DeviceTwin(BAR, field[None], SEATS).at(np.ones(1))
    as_held = TWIN.at(np.zeros(6), held)
    for body, patches in (as_state, as_held):
        assert body.vertices == pytest.approx(BAR.vertices + field, abs=1e-9)
        for patch, seat in zip(patches, SEATS, strict=True):
            assert patch.center == pytest.approx(held.turn @ seat.center + held.shift, abs=1e-6)
            assert patch.axes == pytest.approx(held.turn @ seat.axes, abs=1e-8)


def test_a_scene_keeps_what_stands_around():
    around = Scene(occluders=(Ball(np.zeros(3), 5.0),), skin=70.0)
    scene = TWIN.scene(UNIT[0], around=around)
    assert scene.skin == 70.0
    assert len(scene.occluders) == 1
    assert len(scene.patches) == 3
    assert scene.body is not None


def test_cords_go_with_the_same_weights():
    paths = np.random.default_rng(0).normal(size=(6, 20, 3))
    weights = np.array([0, 0.5, 0, 0.2, 0, 0.1])
    assert blend(paths, weights) == pytest.approx(np.einsum("s,spi->pi", weights, paths))


def test_a_ramp_goes_through_its_states():
    for level, unit in zip(LEVELS, np.eye(4), strict=True):
        assert RAMPS[0].weights(np.array(level)) == pytest.approx(unit)
    assert RAMPS[0].weights(np.array(0.0)) == pytest.approx(np.zeros(4))
    between = blend(FIELDS[:4], RAMPS[0].weights(np.array(0.625)))
    exact = bent(BAR.vertices, 0.8 * 0.625) - BAR.vertices
    straight = 0.625 * FIELDS[3]
    assert np.abs(between - exact).max() < 0.05
    assert np.abs(straight - exact).max() > 2


def test_a_motion_is_smooth_and_comes_past_every_pose():
    motion = draw_motion(RAMPS, 20.0, np.random.default_rng(2))
    t = np.arange(0, motion.times[-1], 1e-3)
    weights, levels = motion.weights(t), motion.levels(t)
    assert motion.times[-1] >= 20
    assert weights.shape == (len(t), 6)
    assert (weights[0] == 0).all()
    assert (levels >= 0).all()
    assert (levels.sum(1) <= 1 + 1e-9).all()
    assert (levels.max(0) > 0.5).all()
    assert np.abs(np.diff(weights, n=2, axis=0)).max() < 4e-4  # a kink would be 3e-3
    assert weights[1234] == pytest.approx(motion.weights(float(t[1234])))
    again = draw_motion(RAMPS, 20.0, np.random.default_rng(2))
    assert (again.keys == motion.keys).all()


def test_a_script():
    motion = script_motion(RAMPS, [(0.0, {}), (1.0, {"bend": 1.0}), (2.0, {"twist": 0.5})])
    assert motion.weights(1.0) == pytest.approx(UNIT[3])
    assert motion.weights(5.0) == pytest.approx(UNIT[4])
    assert motion.weights(-1.0) == pytest.approx(np.zeros(6))
    with raises(CaptureError, "unknown-pose", pose="squeeze"):
        script_motion(RAMPS, [(0.0, {"squeeze": 1.0})])


def test_a_hand_is_never_quite_still():
    hand = draw_sway(np.random.default_rng(0), np.array([50, 0, 0.0]), shift=4.0, degrees=6.0)
    at = [hand.at(t) for t in np.arange(0, 20, 0.1)]
    moved = np.array([h.turn @ [50, 0, 0] + h.shift - [50, 0, 0] for h in at])
    assert 1 < np.linalg.norm(moved, axis=1).max() < 4 * 3
    assert np.abs(np.diff(moved, axis=0)).max() < 2
    for h in at[::50]:
        assert h.turn @ h.turn.T == pytest.approx(np.eye(3), abs=1e-12)


def test_what_does_not_go_together():
    with raises(CaptureError, "displacements-do-not-fit"):
        DeviceTwin(BAR, FIELDS[:, 1:], SEATS)
    with raises(CaptureError, "levels-not-increasing"):
        Ramp("bend", np.array([0.5, 0.25]), np.array([0, 1]))
    with raises(CaptureError, "ramp-sizes-differ"):
        Ramp("bend", np.array([0.5]), np.array([0, 1]))
    with raises(CaptureError, "motion-sizes-differ"):
        Motion(RAMPS, np.array([0.0, 1.0]), np.zeros((2, 3)))
    with raises(CaptureError, "motion-not-increasing"):
        Motion(RAMPS, np.array([1.0, 1.0]), np.zeros((2, 2)))
