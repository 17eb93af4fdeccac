"""Errors of a trained model on frames with gaps, several runs and poses, and unknown noise."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.decoding.expected_errors import measure_errors
from defsense_fab.training.evaluation.evaluate import evaluate
from defsense_fab.training.evaluation.marker_motion import velocities
from defsense_fab.training.regression.frames import Frames, split_frames
from tests.support.errors import raises
from tests.training import soft_bar as bar


@pytest.fixture(scope="module")
def model():
    return bar.trained(bar.dataset())


def edited(run, **arrays):
    return bar.dataset(replace(run, **arrays))


def test_measures_without_gaps_agree_with_the_design(model):
    data = bar.dataset(bar.recording(20, seed=1))
    result = evaluate(model, data)
    r = data.recordings[0]
    said = model.decode(r.sample_time, r.signals, r.time).points
    expected = measure_errors(said, r.points, np.full(6, 1 / 6))
    assert result.total.rmse == pytest.approx(expected.rmse, rel=1e-12)
    assert result.total.peak == pytest.approx(expected.peak, rel=1e-12)
    assert result.total.average_peak == pytest.approx(expected.average_peak, rel=1e-12)
    assert result.total.deviation == pytest.approx(expected.per_state.std(), rel=1e-12)
    assert result.total.frames == len(r.time)
    assert result.total.rmse > 0.05


def test_hand_computed_values():
    """Two frames and two markers, one hidden in the second: errors of 3 and 4 mm, then 1 mm."""
    model = bar.trained(bar.dataset())
    run = bar.recording(2)
    said = model.decode(run.sample_time, run.signals, run.time[:2]).points
    points = np.full((2, 6, 3), np.nan)
    points[0, :2] = said[0, :2] + [[3, 0, 0], [0, 4, 0]]
    points[1, 0] = said[1, 0] + [0, 0, 1]
    result = evaluate(model, edited(run, time=run.time[:2], points=points, sigma=points * np.nan))
    first, second = np.sqrt((9 + 16) / 2), 1.0
    assert result.total.rmse == pytest.approx(np.sqrt((first**2 + second**2) / 2))
    assert result.total.deviation == pytest.approx((first - second) / 2)
    assert (result.total.peak, result.total.average_peak) == pytest.approx((4, 2.5))
    assert result.marker_rmse[:2] == pytest.approx([np.sqrt(5), 4])
    assert result.marker_peak[:2] == pytest.approx([3, 4])
    assert np.isnan(result.marker_rmse[2:]).all()
    assert np.isnan(result.marker_peak[2:]).all()
    assert result.camera_noise is None
    assert result.rmse_without_noise is None


def test_gaps_do_not_count(model):
    """A missing coordinate counts like a missing marker."""
    run = bar.recording(20, seed=1)
    far = run.points.copy()
    far[100:200, 2] = np.nan
    half = run.points.copy()
    half[100:200, 2, 1] = np.nan  # a position needs all coordinates
    result, same = (evaluate(model, edited(run, points=p)).total for p in (far, half))
    assert result == same
    assert result.rmse == pytest.approx(evaluate(model, edited(run)).total.rmse, rel=0.05)


def test_frames_that_cannot_be_tested_are_counted(model):
    run = bar.recording(20, seed=1)
    points, ohm = run.points.copy(), run.ohm.copy()
    points[:40] = np.nan
    ohm[(run.sample_time > 10) & (run.sample_time < 12), 1] = np.nan
    result = evaluate(model, edited(run, points=points, ohm=ohm)).frames
    missed = ((run.time > 9.98) & (run.time < 12)).sum()
    assert result.omitted.without_markers == 40
    assert abs(result.omitted.without_samples - missed) <= 1
    assert len(result.time) == len(run.time) - 40 - result.omitted.without_samples


def test_the_last_share_matches_the_split_of_training(model):
    """The share is of all runs together."""
    first = bar.recording(20, seed=1)
    points = first.points.copy()
    points[50:90] = np.nan
    runs = replace(first, points=points), bar.recording(10, seed=2, name="run-2")
    data = bar.dataset(*runs)
    for share in (0.3, 0.6):
        result = evaluate(model, data, share).frames
        _, held_out = split_frames(Frames.from_dataset(data), share)
        assert (result.run == held_out.recording_index).all()
        assert (result.time == held_out.time).all()
    assert result.omitted.without_markers == 0
    assert (np.diff(result.elapsed) > 0).all()
    assert result.elapsed[-1] == pytest.approx(0.6 * (30 - 40 / 30), abs=0.3)
    assert evaluate(model, data).frames.omitted.without_markers == 40


def test_errors_by_pose(model):
    run = bar.recording(30, seed=1)
    result = evaluate(model, bar.dataset(run))
    assert result.frames.poses == ("bend", "twist", "bend and twist")
    total = sum(p.frames * p.rmse**2 for p in result.by_pose) / result.total.frames
    assert total == pytest.approx(result.total.rmse**2)
    assert result.frames.pose[run.time < 10].tolist() == [0] * int((run.time < 10).sum())
    late = edited(run, poses=((12.0, "twist"),))
    assert evaluate(model, late).frames.poses == ("before the first pose", "twist")
    assert evaluate(model, edited(run, poses=())).frames.poses == ("all",)


def test_camera_noise_is_subtracted(model):
    """An exact model has no error except the known noise."""
    run = bar.recording(30)
    exact = model.decode(run.sample_time, run.signals, run.time).points
    rng = np.random.default_rng(0)
    noisy = edited(
        run, points=exact + rng.normal(0, 0.2, exact.shape), sigma=np.full(exact.shape, 0.2)
    )
    result = evaluate(model, noisy)
    assert result.camera_noise == pytest.approx(0.2 * np.sqrt(3))
    assert result.total.rmse == pytest.approx(0.2 * np.sqrt(3), rel=0.02)
    assert result.rmse_without_noise < 0.06
    shifted = noisy.recordings[0].points + np.array([1.0, 0, 0])
    wrong = edited(run, points=shifted, sigma=np.full(exact.shape, 0.2))
    assert evaluate(model, wrong).rmse_without_noise == pytest.approx(1.0, rel=0.02)


def test_hysteresis_shows_in_the_direction_of_movement():
    """Signals that lead are decoded too far out on the way out, and too near on the way back."""
    model = bar.trained(bar.dataset(bar.recording(60)))
    result = evaluate(model, bar.dataset(bar.recording(60, seed=3, memory=0.3)))
    out = result.by_speed.too_far[result.by_speed.edges[1:] > 5]
    back = result.by_speed.too_far[result.by_speed.edges[1:] < -5]
    assert np.nanmean(out) > 0.3
    assert np.nanmean(back) < -0.3
    assert result.by_speed.frames.sum() == np.isfinite(result.speed).sum()
    plain = evaluate(model, bar.dataset(bar.recording(60, seed=3)))
    assert np.nanmax(np.abs(plain.by_speed.too_far)) < 0.3


def test_marker_velocities():
    """Velocities are exact for straight paths at uneven times, and NaN across gaps."""
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.02, 0.05, 30))
    time[20:] += 5
    going = np.array([[3.0, -4.0, 12.0], [0, 0, 1]])
    points = 1000 + time[:, None, None] * going
    points[5, 1] = np.nan
    result = velocities(time, points, np.zeros(30, int))
    assert np.isnan(result[5, 1]).all()
    assert np.isfinite(result[6, 1]).all()
    good = np.isfinite(result).all(2)
    assert good.sum() == 59
    assert result[good] == pytest.approx(np.broadcast_to(going, result.shape)[good])
    apart = velocities(np.arange(30.0), points, np.zeros(30, int))
    assert np.isnan(apart).all()


def test_interval_coverage():
    """Intervals of 90 % contain 90 % of the training data, and less of drifting data.

    Beyond the trained range they grow, so that they contain more of it.
    """
    data = bar.dataset(bar.recording(60))
    model = bar.trained(data)
    result = evaluate(model, data).coverage
    assert result.level == 0.9
    assert result.share == pytest.approx(0.9, abs=0.005)
    assert len(result.by_pose) == 3
    drifting = bar.dataset(bar.recording(60, drift=0.05))
    constant = replace(model.main.intervals, reach=1e9)
    never_growing = replace(model, main=replace(model.main, intervals=constant))
    by_tenth = evaluate(never_growing, drifting).coverage.by_tenth
    assert by_tenth[0] > 0.6
    assert by_tenth[-1] < 0.5
    assert evaluate(model, drifting).coverage.by_tenth[-1] > by_tenth[-1]
    none = replace(model, main=replace(model.main, intervals=None))
    assert evaluate(none, data).coverage is None


def test_frames_beyond_the_trained_range(model):
    run = bar.recording(30, seed=1)
    result = evaluate(model, edited(run, ohm=bar.R0 * (1 + 2.0 * run.signals)))
    assert result.inside.frames + result.outside.frames == result.total.frames
    assert result.outside.frames > 100
    assert result.outside.rmse > 1.5 * result.inside.rmse


def test_the_order_of_channels_and_markers_does_not_matter(model):
    run = bar.recording(20, seed=1)
    c, m = [2, 0, 1], [5, 4, 0, 1, 2, 3]
    turned = replace(
        bar.dataset(replace(run, ohm=run.ohm[:, c], rest=run.rest[c], points=run.points[:, m])),
        channels=tuple(bar.CHANNELS[k] for k in c),
        ids=bar.IDS[m],
        rest_points=bar.REST[m],
    )
    assert evaluate(model, turned).total == evaluate(model, bar.dataset(run)).total


def test_invalid_input_is_refused(model):
    data = bar.dataset(bar.recording(5))
    with raises(TrainingError, "layouts-differ", layouts=("abc", "other")):
        evaluate(model, replace(data, layout="other"))
    missing = ("upper", "marker 3")
    with raises(TrainingError, "channels-or-markers-missing", missing=missing):
        evaluate(
            model,
            replace(data, channels=("x", "lower", "side"), ids=bar.IDS + 100 * (bar.IDS == 3)),
        )
    with raises(TrainingError, "out-of-range", share=0.0):
        evaluate(model, data, 0.0)
    run = data.recordings[0]
    with raises(TrainingError, "no-frames", count=len(run.time)):
        evaluate(model, edited(run, ohm=run.ohm * np.nan))


def test_a_device_at_rest(model):
    """Such a device has no direction of movement."""
    run = bar.recording(10)
    points = np.broadcast_to(bar.REST, run.points.shape)
    result = evaluate(model, edited(run, ohm=np.broadcast_to(bar.R0, run.ohm.shape), points=points))
    assert np.isnan(result.by_speed.too_far).all()
    assert result.by_speed.frames.sum() == len(run.time)
