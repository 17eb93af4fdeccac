"""Repeatability measures differences between shows of a shape, not recurring errors."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.training.fitting.repeatability import measure_repeatability
from defsense_fab.training.regression.frames import Frames
from tests.training import soft_bar as bar


@pytest.fixture(scope="module")
def frames():
    """Return frames of two shapes held in turn for 10 s, with noise and gaps."""
    time = np.arange(0.0, 300.0, 0.1)
    bend = np.where((time // 10) % 2 < 1, 0.0, 12.0)
    rng = np.random.default_rng(3)
    points = bar.points_of(bend, 0 * bend) + 0.1 * rng.normal(size=(len(time), 6, 3))
    points[rng.random(points.shape[:2]) < 0.05] = np.nan
    run = bar.recording(300)
    run = replace(run, time=time, points=points, sigma=np.full(points.shape, 0.1))
    return Frames.from_dataset(bar.dataset(run)), bend


def said(frames, bend, added):
    """Return true displacements plus an error (t,) in mm along z of every marker."""
    out = bar.points_of(bend, 0 * bend)[: len(frames)] - bar.REST
    out[..., 2] += np.asarray(added)[: len(frames), None]
    return out


def test_errors_that_recur_with_a_shape_do_not_count(frames):
    data, bend = frames
    result = measure_repeatability(data, said(data, bend, 0.5 + 0.1 * bend))
    assert result is not None
    assert result.at_once + result.drift < 0.03
    assert result.cameras == pytest.approx(0.03)
    assert result.share > 0.95


def test_differences_between_shows_are_measured(frames):
    data, bend = frames
    show = np.random.default_rng(1).normal(size=31)[(data.time // 10).astype(int)]
    result = measure_repeatability(data, said(data, bend, show))
    assert result is not None
    assert result.at_once + result.drift == pytest.approx(np.var(show), rel=0.25)


def test_drift_is_distinguished_from_immediate_differences(frames):
    data, bend = frames
    result = measure_repeatability(data, said(data, bend, 2 * data.time / 300))
    assert result is not None
    assert result.drift > 3 * result.at_once


def test_clock_errors_matter_during_movement(frames):
    data, bend = frames
    moving = bar.recording(60, sigma=0.05)
    slow = measure_repeatability(data, said(data, bend, 0 * bend))
    fast = Frames.from_dataset(bar.dataset(moving))
    quick = measure_repeatability(fast, np.nan_to_num(fast.points) - bar.REST)
    assert slow is not None
    assert quick is not None
    assert quick.clocks > 0
    unknown = replace(fast, dataset=bar.dataset(replace(moving, sync_error=None)))
    none = measure_repeatability(unknown, np.nan_to_num(unknown.points) - bar.REST)
    assert none is not None
    assert none.clocks == 0


def test_shapes_that_never_recur_give_no_result():
    time = np.arange(0.0, 60.0, 0.1)
    run = replace(
        bar.recording(60),
        time=time,
        points=bar.points_of(time, 0 * time),
        sigma=np.full((len(time), 6, 3), 0.001),
    )
    frames = Frames.from_dataset(bar.dataset(run))
    assert measure_repeatability(frames, np.zeros(frames.points.shape)) is None
