"""Checks of datasets detect every kind of problem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import TrainingError
from defsense_fab.training.data.dataset_checks import check_dataset, require_trainable
from defsense_fab.training.data.time_alignment import align_samples, find_time_shift
from tests.support.errors import raises
from tests.training.synthetic import IDS, QUIET, R0, REST, dataset, recording

pytestmark = pytest.mark.slow


def only_problem(problems, code):
    """Return the only problem with this code."""
    (problem,) = [p for p in problems if p.code == code]
    return problem


def of_channel(r, k, change):
    """Return the recording with changed resistances of one channel."""
    ohm = r.ohm.copy()
    ohm[:, k] = change(ohm[:, k])
    return replace(r, ohm=ohm)


@pytest.fixture(scope="module")
def good():
    return dataset()


def test_a_good_dataset_has_no_problems(good):
    assert check_dataset(good) == ()
    assert require_trainable(good) == ()
    three = dataset(*(recording(k, session=f"s{k}") for k in (1, 2, 3)))
    assert check_dataset(three) == ()


@pytest.mark.parametrize(
    ("key", "code"), [("device", "different-devices"), ("layout", "different-layouts-of-cords")]
)
def test_sessions_of_different_devices_or_layouts(good, key, code):
    sessions = [{"folder": "a", key: "one"}, {"folder": "b", key: "two"}, {"folder": "c", key: ""}]
    mixed = replace(good, provenance={"sessions": sessions})
    problem = only_problem(check_dataset(mixed), code)
    assert problem.is_fatal
    assert problem.data["folders"] == {"one": "a", "two": "b"}
    with raises(TrainingError, code):
        require_trainable(mixed)


def test_a_missing_channel(good):
    gone = of_channel(good.recordings[0], 1, lambda R: np.full_like(R, np.nan))
    problem = only_problem(check_dataset(dataset(gone, good.recordings[1])), "missing-channel")
    assert (problem.recordings, problem.data["channels"]) == (("session-1/run-1",), ("middle",))
    rest = replace(good.recordings[0], rest=R0 * [1, np.nan, 1])
    assert only_problem(check_dataset(dataset(rest)), "missing-channel").is_fatal


def test_permuted_channels(good):
    a, b = good.recordings
    swapped = replace(b, ohm=b.ohm[:, [1, 0, 2]], rest=b.rest[[1, 0, 2]])
    problems = check_dataset(dataset(a, swapped))
    problem = only_problem(problems, "permuted-channels")
    assert problem.is_fatal
    assert problem.recordings == ("session-2/run-1",)
    assert problem.data["session"] == "session-2"
    assert problem.data["order"] == {"left": "middle", "middle": "left"}
    by_sessions = problem.data["source"]
    turned = replace(b, ohm=b.ohm[:, [2, 0, 1]], rest=b.rest[[2, 0, 1]], unit="other")
    # Another unit is compared with its prediction.
    assert "permuted-channels" not in {p.code for p in check_dataset(dataset(a, turned))}
    predicted = {b.name: np.stack([np.interp(b.time, b.sample_time, s) for s in b.signals.T], 1)}
    problem = only_problem(
        check_dataset(dataset(a, turned), predicted=predicted), "permuted-channels"
    )
    assert problem.data["order"]["left"] == "right"
    assert problem.data["source"] != by_sessions


@pytest.mark.parametrize(
    ("bad", "state"), [(np.inf, "open"), (np.nan, "open"), (0.0, "shorted"), (-5.0, "shorted")]
)
def test_a_channel_that_is_open_or_shorted_for_seconds(good, bad, state):
    def broken(seconds):
        def change(R):
            out = R.copy()
            out[600 : 600 + int(60 * seconds)] = bad
            return out

        return dataset(of_channel(good.recordings[0], 2, change), good.recordings[1])

    problem = only_problem(check_dataset(broken(4.0)), "saturated-channel")
    assert not problem.is_fatal
    assert (problem.data["channel"], problem.data["state"]) == ("right", state)
    assert problem.value == pytest.approx(0.1)
    assert problem.data["longest_s"] == pytest.approx(4.0)
    assert check_dataset(broken(0.5)) == ()
    assert only_problem(check_dataset(broken(25.0)), "saturated-channel").is_fatal


def test_a_clipped_channel(good):
    top = np.percentile(good.recordings[0].ohm[:, 0], 80)
    clipped = of_channel(good.recordings[0], 0, lambda R: np.minimum(R, top))
    problem = only_problem(check_dataset(dataset(clipped, good.recordings[1])), "saturated-channel")
    assert (problem.data["channel"], problem.data["state"]) == ("left", "clipped")
    assert problem.value == pytest.approx(0.2, abs=0.005)
    # At rest, a coarse converter gives constant values, even at the lower end of the range.
    rest = good.recordings[0].sample_time < QUIET
    low = float(good.recordings[0].ohm[:, 0].min())
    quiet = of_channel(good.recordings[0], 0, lambda R: np.where(rest, low, R))
    assert check_dataset(dataset(quiet, good.recordings[1])) == ()


def test_a_stuck_or_constant_channel(good):
    def stuck(R):
        return np.where(np.abs(np.arange(len(R)) - 1500) < 150, R[1500], R)

    problem = only_problem(
        check_dataset(dataset(of_channel(good.recordings[0], 1, stuck), good.recordings[1])),
        "stuck-channel",
    )
    assert problem.data["channel"] == "middle"
    assert problem.value == pytest.approx(5.0, abs=0.05)
    assert problem.data["start_s"] == pytest.approx(22.5, abs=0.05)
    flat = [of_channel(r, 1, lambda R: np.full_like(R, 2100.0)) for r in good.recordings]
    problem = only_problem(check_dataset(dataset(*flat)), "constant-channel")
    assert problem.is_fatal
    assert problem.data["channels"] == ("middle",)
    # It is not reported as clipped or stuck too.
    assert [p.code for p in check_dataset(dataset(*flat)) if p.is_fatal] == ["constant-channel"]
    one = only_problem(check_dataset(dataset(flat[0], good.recordings[1])), "stuck-channel")
    assert one.is_fatal


def test_a_copy_of_a_recording(good):
    """The copy has another name and rounded resistances."""
    r = good.recordings[0]
    copy = replace(r, name="copy/run-1", session="copy", ohm=np.round(r.ohm, 3))
    problem = only_problem(check_dataset(dataset(r, copy)), "same-recording")
    assert problem.is_fatal
    assert problem.recordings == ("copy/run-1", "session-1/run-1")


def test_samples_that_end_before_the_frames(good):
    r = good.recordings[0]
    cut = replace(r, sample_time=r.sample_time[:1500], ohm=r.ohm[:1500])
    problem = only_problem(
        check_dataset(dataset(cut, good.recordings[1])), "frames-without-samples"
    )
    assert not problem.is_fatal
    assert problem.value == pytest.approx(1 - 25 / 40, abs=0.01)
    assert problem.recordings == (r.name,)


def test_no_rest_pose(good):
    def late(r):
        kept = r.time > QUIET + 2
        return replace(r, time=r.time[kept], points=r.points[kept], sigma=r.sigma[kept])

    one = check_dataset(dataset(late(recording(1, noise=1e-4)), good.recordings[1]))
    assert not only_problem(one, "no-rest-pose").is_fatal
    away = [replace(r, points=r.points + 9 * np.eye(3)[2]) for r in good.recordings]
    problem = only_problem(check_dataset(dataset(*away)), "no-rest-pose")
    assert problem.is_fatal
    assert problem.recordings == ("session-1/run-1", "session-2/run-1")


def test_too_few_frames(good):
    short = recording(1, 1.5)
    problem = only_problem(check_dataset(dataset(short)), "too-few-frames")
    assert problem.is_fatal
    assert 40 < problem.value <= 45
    assert problem.data["needed"] == 50
    problem = only_problem(check_dataset(dataset(good.recordings[0])), "few-frames")
    assert not problem.is_fatal
    assert problem.value == pytest.approx(40, abs=0.5)
    # Frames without signals do not count.
    r = good.recordings[0]
    gone = replace(r, sample_time=r.sample_time[:40], ohm=r.ohm[:40])
    assert only_problem(check_dataset(dataset(gone)), "too-few-frames").value == 20
    # Causes are reported first.
    dead = of_channel(r, 0, lambda R: np.full_like(R, np.nan))
    kinds = [p.code for p in check_dataset(dataset(dead)) if p.is_fatal]
    assert kinds[0] == "missing-channel"
    assert "too-few-frames" in kinds
    elsewhere = replace(r, sample_time=r.sample_time + 1000)
    problem = only_problem(check_dataset(dataset(elsewhere)), "out-of-step")
    assert problem.is_fatal
    assert problem.recordings == (r.name,)


def test_frames_without_markers(good):
    r = good.recordings[0]
    points = r.points.copy()
    points[::3], points[1::3] = np.nan, np.nan
    points[:, 3] = np.nan
    hidden = dataset(replace(r, points=points), replace(good.recordings[1], points=points))
    problems = check_dataset(hidden)
    result = [p for p in problems if p.code == "frames-without-markers"]
    assert [p.recordings for p in result] == [("session-1/run-1",), ("session-2/run-1",)]
    assert result[0].value == pytest.approx(2 / 3, abs=0.01)
    assert only_problem(problems, "markers-never-seen").data["markers"] == (IDS[3],)
    nothing = replace(r, points=np.full_like(points, np.nan))
    assert only_problem(
        check_dataset(dataset(nothing, good.recordings[1])), "frames-without-markers"
    ).is_fatal


@pytest.mark.parametrize("late", [0.5, -0.5, 0.14, 0.93])
def test_signals_out_of_step(good, late):
    off = dataset(recording(1, late=late), good.recordings[1])
    problem = only_problem(check_dataset(off), "out-of-step")
    assert problem.recordings == ("session-1/run-1",)
    assert problem.value == pytest.approx(-late, abs=0.04)
    assert not problem.is_fatal
    assert problem.data["is_future"] == (late > 0)
    aligned, notes = align_samples(off, "auto")
    assert check_dataset(aligned) == ()
    assert aligned.provenance["shifts"] == {problem.recordings[0]: problem.value}
    assert len(notes) == 1
    assert ("future" in notes[0]) == (late > 0)
    both, notes = align_samples(dataset(recording(1, late=late), recording(2, late=late)), -late)
    assert len(notes) == (late > 0)
    for r, true in zip(both.recordings, good.recordings, strict=True):
        np.testing.assert_allclose(r.sample_time, true.sample_time, atol=1e-9)


def test_relaxation_is_not_taken_for_a_shift(good):
    for r in good.recordings:
        assert abs(find_time_shift([r]).seconds) < 0.06
    still = recording(1, 20.0)
    still = replace(still, points=np.broadcast_to(REST, still.points.shape))
    assert find_time_shift([still]) is None
    rng = np.random.default_rng(0)
    noise = replace(good.recordings[0], ohm=R0 + rng.normal(size=good.recordings[0].ohm.shape))
    assert not find_time_shift([noise]).is_informative
    problem = only_problem(check_dataset(dataset(noise)), "signals-tell-nothing")
    assert problem.is_fatal


def test_a_layout_that_senses_little_does_not_forbid_training():
    """Its signals correlate with the simulation, so they are in step."""
    r = recording(9)
    rng = np.random.default_rng(2)
    expected = 1e-3 * rng.normal(size=(len(r.time), 3))
    at = np.stack([np.interp(r.sample_time, r.time, e) for e in expected.T], axis=1)
    noise = replace(r, ohm=r.rest * (1 + at + 3e-4 * rng.normal(size=r.ohm.shape)))
    only_problem(check_dataset(dataset(noise)), "signals-tell-nothing")
    problem = only_problem(
        check_dataset(dataset(noise), predicted={r.name: expected}), "cords-tell-little"
    )
    assert not problem.is_fatal
    other = 1e-3 * rng.normal(size=expected.shape)
    only_problem(check_dataset(dataset(noise), predicted={r.name: other}), "signals-tell-nothing")
    with raises(TrainingError, "signals-tell-nothing"):
        require_trainable(dataset(noise), predicted={r.name: other})
    known = require_trainable(dataset(noise), predicted={r.name: other}, is_synchronized=True)
    assert "signals-tell-nothing" in {p.code for p in known}
    # If the prediction is informative, the layout is not the reason, even if a channel correlates.
    strong = r.signals_at(r.time)
    strong[:, 0] = expected[:, 0]
    only_problem(check_dataset(dataset(noise), predicted={r.name: strong}), "signals-tell-nothing")


def test_a_replaced_cord(good):
    drifted = [recording(k, rest=R0 * (1 + 0.02 * k), session=f"s{k}") for k in (1, 2, 3, 4)]
    assert check_dataset(dataset(*drifted)) == ()
    other = recording(5, rest=R0 * [1.0, 1.5, 1.0], session="s5")
    problem = only_problem(check_dataset(dataset(*drifted, other)), "replaced-cord")
    assert problem.recordings == ("s5/run-1",)
    assert problem.data == {"session": "s5", "channel": "middle"}
    assert problem.value == pytest.approx(1.47, abs=0.01)
    two = check_dataset(dataset(drifted[0], other))
    assert only_problem(two, "replaced-cord").data["channel"] == "middle"
    assert only_problem(two, "replaced-cord").value > 1
    # Another unit has other cords.
    assert check_dataset(dataset(*drifted, replace(other, unit="unit-2"))) == ()
    # All cords at once: another temperature.
    warm = recording(5, rest=R0 * 1.3, session="s5")
    assert check_dataset(dataset(*drifted, warm)) == ()
    # The same R0, another rubber.
    softer = of_channel(recording(5, session="s5"), 0, lambda R: R0[0] + 1.7 * (R - R0[0]))
    problem = only_problem(check_dataset(dataset(*drifted, softer)), "changed-gain")
    assert problem.recordings == ("s5/run-1",)
    assert problem.value == pytest.approx(1.7, rel=0.1)
    assert problem.data == {"session": "s5", "channel": "left"}


def test_positions_that_are_not_numbers(good):
    r = good.recordings[0]
    points = r.points.copy()
    points[300, 2, 1] = np.nan
    problem = only_problem(check_dataset(dataset(replace(r, points=points))), "no-number")
    assert problem.is_fatal
    assert problem.data["markers"] == (IDS[2],)
    assert problem.data["time_s"] == pytest.approx(10.0)
    points[300, 2] = np.inf
    assert only_problem(check_dataset(dataset(replace(r, points=points))), "no-number").is_fatal
    rest = REST.copy()
    rest[1] = np.nan
    problem = only_problem(check_dataset(dataset(rest_points=rest)), "no-number")
    assert problem.data["markers"] == (2,)
    # All problems are counted.
    both = dataset(replace(r, points=points), rest_points=rest)
    with raises(TrainingError, "no-number", count=2):
        require_trainable(both)
