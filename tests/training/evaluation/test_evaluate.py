"""Error measures of a trained model on frames with gaps, runs of several poses, and unknown
noise."""

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


def test_without_gaps_the_measures_are_those_of_the_design(model):
    data = bar.dataset(bar.recording(20, seed=1))
    found = evaluate(model, data)
    r = data.recordings[0]
    said = model.decode(r.sample_time, r.signals, r.time).points
    expected = measure_errors(said, r.points, np.full(6, 1 / 6))
    assert found.total.rmse == pytest.approx(expected.rmse, rel=1e-12)
    assert found.total.peak == pytest.approx(expected.peak, rel=1e-12)
    assert found.total.average_peak == pytest.approx(expected.average_peak, rel=1e-12)
    assert found.total.deviation == pytest.approx(expected.per_state.std(), rel=1e-12)
    assert found.total.frames == len(r.time)
    assert found.total.rmse > 0.05


def test_by_hand():
    """Two frames, two markers, one of them not seen in the second: 3 and 4 mm off, then 1 mm."""
    model = bar.trained(bar.dataset())
    run = bar.recording(2)
    said = model.decode(run.sample_time, run.signals, run.time[:2]).points
    points = np.full((2, 6, 3), np.nan)
    points[0, :2] = said[0, :2] + [[3, 0, 0], [0, 4, 0]]
    points[1, 0] = said[1, 0] + [0, 0, 1]
    found = evaluate(model, edited(run, time=run.time[:2], points=points, sigma=points * np.nan))
    first, second = np.sqrt((9 + 16) / 2), 1.0
    assert found.total.rmse == pytest.approx(np.sqrt((first**2 + second**2) / 2))
    assert found.total.deviation == pytest.approx((first - second) / 2)
    assert (found.total.peak, found.total.average_peak) == pytest.approx((4, 2.5))
    assert found.marker_rmse[:2] == pytest.approx([np.sqrt(5), 4])
    assert found.marker_peak[:2] == pytest.approx([3, 4])
    assert np.isnan(found.marker_rmse[2:]).all()
    assert np.isnan(found.marker_peak[2:]).all()
    assert found.camera_noise is None
    assert found.rmse_without_noise is None


def test_gaps_do_not_count(model):
    """A marker that was far off where it is a gap now changes nothing."""
    run = bar.recording(20, seed=1)
    far = run.points.copy()
    far[100:200, 2] = np.nan
    half = run.points.copy()
    half[100:200, 2, 1] = np.nan  # one coordinate is no position
    found, same = (evaluate(model, edited(run, points=p)).total for p in (far, half))
    assert found == same
    assert found.rmse == pytest.approx(evaluate(model, edited(run)).total.rmse, rel=0.05)


def test_frames_that_cannot_be_tested_are_counted(model):
    run = bar.recording(20, seed=1)
    points, ohm = run.points.copy(), run.ohm.copy()
    points[:40] = np.nan
    ohm[(run.sample_time > 10) & (run.sample_time < 12), 1] = np.nan
    found = evaluate(model, edited(run, points=points, ohm=ohm)).frames
    missed = ((run.time > 9.98) & (run.time < 12)).sum()
    assert found.without_markers == 40
    assert abs(found.without_samples - missed) <= 1
    assert len(found.time) == len(run.time) - 40 - found.without_samples


def test_the_last_share_is_that_which_was_not_trained_on(model):
    """Of all runs together, as training divides them."""
    first = bar.recording(20, seed=1)
    points = first.points.copy()
    points[50:90] = np.nan
    runs = replace(first, points=points), bar.recording(10, seed=2, name="run-2")
    data = bar.dataset(*runs)
    for share in (0.3, 0.6):
        found = evaluate(model, data, share).frames
        _, held_out = split_frames(Frames.from_dataset(data), share)
        assert (found.run == held_out.recording_index).all()
        assert (found.time == held_out.time).all()
    assert found.without_markers == 0
    assert (np.diff(found.elapsed) > 0).all()
    assert found.elapsed[-1] == pytest.approx(0.6 * (30 - 40 / 30), abs=0.3)
    assert evaluate(model, data).frames.without_markers == 40


def test_by_pose(model):
    run = bar.recording(30, seed=1)
    found = evaluate(model, bar.dataset(run))
    assert found.frames.poses == ("bend", "twist", "bend and twist")
    total = sum(p.frames * p.rmse**2 for p in found.by_pose) / found.total.frames
    assert total == pytest.approx(found.total.rmse**2)
    assert found.frames.pose[run.time < 10].tolist() == [0] * int((run.time < 10).sum())
    late = edited(run, poses=((12.0, "twist"),))
    assert evaluate(model, late).frames.poses == ("before the first pose", "twist")
    assert evaluate(model, edited(run, poses=())).frames.poses == ("all",)


def test_noise_of_the_cameras_is_taken_out(model):
    """A model that is right but for noise of known size has no error but that."""
    run = bar.recording(30)
    exact = model.decode(run.sample_time, run.signals, run.time).points
    rng = np.random.default_rng(0)
    noisy = edited(
        run, points=exact + rng.normal(0, 0.2, exact.shape), sigma=np.full(exact.shape, 0.2)
    )
    found = evaluate(model, noisy)
    assert found.camera_noise == pytest.approx(0.2 * np.sqrt(3))
    assert found.total.rmse == pytest.approx(0.2 * np.sqrt(3), rel=0.02)
    assert found.rmse_without_noise < 0.06
    shifted = noisy.recordings[0].points + np.array([1.0, 0, 0])
    wrong = edited(run, points=shifted, sigma=np.full(exact.shape, 0.2))
    assert evaluate(model, wrong).rmse_without_noise == pytest.approx(1.0, rel=0.02)


def test_hysteresis_is_seen_by_the_direction():
    """Cords that lead by their memory are decoded too far out on the way out, and not far enough
    on the way back."""
    model = bar.trained(bar.dataset(bar.recording(60)))
    found = evaluate(model, bar.dataset(bar.recording(60, seed=3, memory=0.3)))
    out = found.by_speed.too_far[found.by_speed.edges[1:] > 5]
    back = found.by_speed.too_far[found.by_speed.edges[1:] < -5]
    assert np.nanmean(out) > 0.3
    assert np.nanmean(back) < -0.3
    assert found.by_speed.frames.sum() == np.isfinite(found.speed).sum()
    plain = evaluate(model, bar.dataset(bar.recording(60, seed=3)))
    assert np.nanmax(np.abs(plain.by_speed.too_far)) < 0.3


def test_speed_of_markers():
    """Exact for straight paths at uneven times, NaN across gaps of the pictures and of a marker."""
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.02, 0.05, 30))
    time[20:] += 5
    going = np.array([[3.0, -4.0, 12.0], [0, 0, 1]])
    points = 1000 + time[:, None, None] * going
    points[5, 1] = np.nan
    found = velocities(time, points, np.zeros(30, int))
    assert np.isnan(found[5, 1]).all()
    assert np.isfinite(found[6, 1]).all()
    good = np.isfinite(found).all(2)
    assert good.sum() == 59
    assert found[good] == pytest.approx(np.broadcast_to(going, found.shape)[good])
    apart = velocities(np.arange(30.0), points, np.zeros(30, int))
    assert np.isnan(apart).all()


def test_coverage():
    """Intervals of 90 % hold 90 % of what they were made on, and less of what drifts away."""
    data = bar.dataset(bar.recording(60))
    model = bar.trained(data)
    found = evaluate(model, data).coverage
    assert found.level == 0.9
    assert found.share == pytest.approx(0.9, abs=0.005)
    assert len(found.by_pose) == 3
    drifting = evaluate(model, bar.dataset(bar.recording(60, drift=0.05)))
    by_tenth = drifting.coverage.by_tenth
    assert by_tenth[0] > 0.6
    assert by_tenth[-1] < 0.5
    none = replace(model, main=replace(model.main, intervals=None))
    assert evaluate(none, data).coverage is None


def test_outside_of_the_trained_range(model):
    run = bar.recording(30, seed=1)
    found = evaluate(model, edited(run, ohm=bar.R0 * (1 + 2.0 * run.signals)))
    assert found.inside.frames + found.outside.frames == found.total.frames
    assert found.outside.frames > 100
    assert found.outside.rmse > 2 * found.inside.rmse


def test_other_orders_of_channels_and_markers(model):
    run = bar.recording(20, seed=1)
    c, m = [2, 0, 1], [5, 4, 0, 1, 2, 3]
    turned = replace(
        bar.dataset(
            replace(run, ohm=run.ohm[:, c], rest=run.rest[c], points=run.points[:, m])
        ),
        channels=tuple(bar.CHANNELS[k] for k in c), ids=bar.IDS[m], rest_points=bar.REST[m],
    )  # fmt: skip
    assert evaluate(model, turned).total == evaluate(model, bar.dataset(run)).total


def test_refusals(model):
    data = bar.dataset(bar.recording(5))
    with raises(TrainingError, "layouts-differ", layouts=("abc", "other")):
        evaluate(model, replace(data, layout="other"))
    missing = ("upper", "marker 3")
    with raises(TrainingError, "channels-or-markers-missing", missing=missing):
        evaluate(
            model,
            replace(data, channels=("x", "lower", "side"), ids=bar.IDS + 100 * (bar.IDS == 3)),
        )
    with raises(TrainingError, "share-out-of-range", share=0.0):
        evaluate(model, data, 0.0)
    run = data.recordings[0]
    with raises(TrainingError, "no-frames", count=len(run.time)):
        evaluate(model, edited(run, ohm=run.ohm * np.nan))


def test_a_device_at_rest(model):
    """It neither goes out nor comes back."""
    run = bar.recording(10)
    points = np.broadcast_to(bar.REST, run.points.shape)
    found = evaluate(model, edited(run, ohm=np.broadcast_to(bar.R0, run.ohm.shape), points=points))
    assert np.isnan(found.by_speed.too_far).all()
    assert found.by_speed.frames.sum() == len(run.time)
