"""Test that compiled loops refuse arguments that do not fit, instead of reading beyond them."""

import numpy as np
import pytest

from defsense_fab.core.machine import kernels

POINTS, LINE = np.zeros((4, 3)), np.array([[0.0, 1.0, 0.0], [2.0, 1.0, 0.0]])
NONE = np.zeros(0)


def call(points=POINTS, line=LINE, separation=0.0, distance=None, more=()):
    distance = np.empty(len(points)) if distance is None else distance
    segment, where = np.empty(len(points), np.int64), np.empty(len(points))
    kernels.nearest_segments(points, line, NONE, NONE, separation, distance, segment, where, *more)
    return distance


def test_fitting_arguments_are_taken_also_from_tuples():
    assert (call() == 1).all()
    segment, where = np.empty(4, np.int64), np.empty(4)
    out = np.empty(4), segment, (where,)
    kernels.nearest_segments((POINTS, LINE), NONE, NONE, 0, out)
    assert (out[0] == 1).all()
    assert (segment == 0).all()


@pytest.mark.parametrize(
    "change",
    [
        {"points": np.zeros((4, 2))},
        {"points": np.zeros(12)},
        {"points": np.zeros((4, 3), np.float32)},
        {"points": np.zeros((4, 3), np.int64)},
        {"points": np.zeros((3, 4)).T},
        {"line": np.zeros((2, 3, 1))},
        {"line": np.zeros((2, 3))[:, ::-1]},
        {"line": np.zeros((0, 3))},
        {"distance": np.empty(3)},
        {"distance": np.empty((4, 1))},
    ],
    ids=lambda c: f"{next(iter(c))} {next(iter(c.values())).shape}",
)
def test_other_arrays_are_refused(change):
    with pytest.raises((ValueError, BufferError)):
        call(**change)


def test_results_need_an_array_that_can_be_changed():
    distance = np.zeros(4)
    distance.flags.writeable = False
    with pytest.raises((ValueError, BufferError)):
        call(distance=distance)


@pytest.mark.parametrize(
    "change", [{"points": [1.0]}, {"separation": "far"}, {"more": (NONE,)}, {"separation": None}]
)
def test_other_types_and_numbers_of_arguments_are_refused(change):
    with pytest.raises(TypeError):
        call(**change)
    with pytest.raises(TypeError):
        kernels.nearest_segments(POINTS, LINE)


def test_ranges_end_within_the_arrays():
    gradients, out = np.zeros((5, 4, 3, 3)), np.zeros((5, 4))
    kernels.volume_ratios(gradients, gradients, 2, 5, out)
    for start, stop in ((0, 6), (-1, 5)):
        with pytest.raises(ValueError, match="argument"):
            kernels.volume_ratios(gradients, gradients, start, stop, out)


def test_rows_of_a_wider_array_are_filled_in_place():
    """Columns around them stay."""
    motion = (np.ones((2, 1)), np.zeros((2, 2)), np.eye(3), np.zeros((0, 3, 3)), np.zeros((2, 3)))
    wide = np.zeros((2, 5))
    kernels.add_path_moves(
        motion,
        np.eye(3)[:2].copy(),
        np.zeros(2),
        4,
        np.array([0, 1]),
        np.ones((2, 3)),
        wide[:, 1:3],
    )
    assert (wide == [[0, 1, 1, 0, 0]] * 2).all()
