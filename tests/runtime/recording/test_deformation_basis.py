"""Shapes with weights against the frames that they approximate."""

import dataclasses

import numpy as np
import pytest

from defsense_fab.core.errors import LiveError
from defsense_fab.runtime.recording.gltf_animation import deformation_basis
from tests.runtime.recording_bars import animation
from tests.support.errors import raises


def largest_error(of, basis):
    shapes = np.einsum("nk,kvi->nvi", basis.weights.astype(float), basis.targets.astype(float))
    return np.linalg.norm(of.rest + shapes - of.positions, axis=2).max()


@pytest.mark.parametrize("tolerance", [0.5, 0.02, 0.001])
def test_every_vertex_is_within_the_tolerance(tolerance):
    """Use 300 frames, which are several chunks."""
    of = animation(300)
    basis = deformation_basis(of, tolerance)
    assert basis.error <= tolerance
    assert basis.error == pytest.approx(largest_error(of, basis), rel=1e-9)
    assert len(basis.targets) < 40
    assert (basis.weights.min(), basis.weights.max()) == (0, 1)
    assert (basis.weights[:, 0] == 1).all()


def test_number_of_targets_is_minimal():
    """A motion of three shapes needs three targets and an offset."""
    rng = np.random.default_rng(1)
    of = animation(50)
    shapes = rng.normal(size=(3, *of.rest.shape))
    weights = rng.normal(size=(50, 3)) * [30, 3, 1]
    positions = of.rest + np.einsum("nk,kvi->nvi", weights, shapes)
    basis = deformation_basis(dataclasses.replace(of, positions=positions.astype(np.float32)))
    assert len(basis.targets) == 4
    assert basis.error < 1e-3


def test_error_of_too_few_targets_is_reported():
    """Noise cannot be represented by a few shapes."""
    rng = np.random.default_rng(2)
    of = animation(100)
    noisy = of.positions + rng.normal(size=of.positions.shape).astype(np.float32)
    of = dataclasses.replace(of, positions=noisy)
    basis = deformation_basis(of, max_targets=10)
    assert len(basis.targets) == 11
    assert basis.error > 1
    assert basis.error == pytest.approx(largest_error(of, basis), rel=1e-9)


def test_animation_without_motion():
    of = animation(3)
    still = np.repeat(of.rest[None].astype(np.float32), 3, axis=0)
    basis = deformation_basis(dataclasses.replace(of, positions=still))
    assert len(basis.targets) == 2
    assert basis.error < 1e-4


def test_vertex_without_a_position_is_refused():
    of = animation(3)
    of.positions[1, 4, 2] = np.nan
    with raises(LiveError, "not-finite", start=0):
        deformation_basis(of)
