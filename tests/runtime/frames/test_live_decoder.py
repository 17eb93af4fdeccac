"""Readings are decoded into frames whose quality says how far they can be trusted."""

from dataclasses import replace

import numpy as np
import pytest

from defsense_fab.core.errors import LiveError
from defsense_fab.decoding.signal_history import Past
from defsense_fab.runtime.frames.live_decoder import LiveDecoder, Reading
from defsense_fab.runtime.frames.live_faults import SwapWatch
from defsense_fab.runtime.frames.live_frame import Quality
from defsense_fab.training.fitting.train_model import train
from defsense_fab.training.options import TrainOptions
from defsense_fab.training.regression.intervals import fit_trained_range
from tests.support.errors import raises
from tests.training.conftest import recorded as recorded_fixture
from tests.training.conftest import relaxed

pytestmark = pytest.mark.slow

recorded = recorded_fixture


@pytest.fixture(scope="module")
def model(recorded):
    return train(recorded(120), TrainOptions(decoder="quadratic", memory=False)).model


@pytest.fixture(scope="module")
def run(recorded):
    """Another minute of the same device, after three seconds of rest."""
    return recorded(60, seed=5).recordings[0]


def play(decoder, run, change=None, rest=3.0, rate=60):
    R0, out = run.rest, []
    rng = np.random.default_rng(0)
    ohms = [R0 * (1 + 2e-4 * rng.normal(size=3)) for _ in range(round(rest * rate))]
    ohms += list(run.ohm)
    for k, now in enumerate(ohms):
        t = k / rate
        now = now if change is None else change(t, now.copy())
        frame = decoder(Reading(t, now, 100.0 + t))
        if frame is not None:
            out.append(frame)
    return out


def errors(frames, run, rest=3.0):
    moved = [f for f in frames if f.time >= rest]
    time = np.array([f.time - rest for f in moved])
    true = np.stack(
        [np.interp(time, run.time, x) for x in run.points.reshape(len(run.time), -1).T], axis=1
    ).reshape(len(time), -1, 3)
    return np.linalg.norm(np.array([f.markers for f in moved]) - true, axis=2)


def test_frames_have_the_markers_that_the_model_decodes(model, run):
    frames = play(LiveDecoder(model, run.rest, follow_drift=False), run)
    found = model.decode(run.sample_time, run.signals, run.sample_time)
    live = np.array([f.markers for f in frames if f.time >= 3.0])
    assert live == pytest.approx(found.points, abs=1e-6)
    assert frames[300].radius == pytest.approx(found.radius[300 - 180], rel=1e-6)
    assert np.sqrt((errors(frames, run) ** 2).mean()) < 0.5


def test_frames_are_lost_until_rest_is_measured(model, run):
    frames = play(LiveDecoder(model), run)
    assert frames[30].quality is Quality.LOST
    assert frames[30].notes[0].code == "measuring-rest"
    assert (frames[30].markers == model.rest_points).all()
    assert np.sqrt((errors(frames, run) ** 2).mean()) < 0.8


def test_torn_cord_is_reported_and_left_out(model, run):
    def tear(t, ohms):
        if t > 10:
            ohms[1] = np.inf
        return ohms

    frames = play(LiveDecoder(model, run.rest), run, tear)
    later = [f for f in frames if f.time > 10.2]
    assert {f.quality for f in later} == {Quality.FALLBACK}
    assert {f.lost_channel for f in later} == {"top"}
    assert (later[0].notes[0].code, later[0].notes[0].data) == ("torn", {"channels": ("top",)})
    first = next(f for f in frames if f.time > 10 and f.quality is Quality.FALLBACK)
    assert first.time < 10.1
    with_it = errors(play(LiveDecoder(model, run.rest), run), run)
    without = errors(frames, run)
    assert np.isfinite(without).all()
    assert (without**2).mean() > (with_it**2).mean()
    kept = play(LiveDecoder(model, run.rest, fallback=False), run, tear)
    assert kept[-1].quality is Quality.LOST


def test_two_lost_cords_keep_the_last_good_shape(model, run):
    def tear(t, ohms):
        if t > 10:
            ohms[:2] = np.inf
        return ohms

    frames = play(LiveDecoder(model, run.rest), run, tear)
    good = [f for f in frames if f.time <= 10][-1]
    assert frames[-1].quality is Quality.LOST
    assert frames[-1].markers == pytest.approx(good.markers, abs=1.0)


def test_readings_outside_the_training_are_untrained(model, run):
    def more(t, ohms):
        return run.rest * (1 + 2.5 * (ohms / run.rest - 1)) if t > 20 else ohms

    frames = play(LiveDecoder(model, run.rest), run, more)
    later = [f.quality for f in frames if f.time > 22]
    assert later.count(Quality.UNTRAINED) > 0.15 * len(later)
    early = [f.quality for f in frames if 4 < f.time < 20]
    assert early.count(Quality.TRUSTED) > 0.95 * len(early)


def test_rest_other_than_in_the_training_is_reported(model, run):
    frames = play(LiveDecoder(model, run.rest, 0.8 * run.rest), run)
    changes = [n.data["change"] for n in frames[-1].notes if n.code == "cord-replaced"]
    assert changes == pytest.approx([0.25] * 3, abs=0.01)


def test_other_channels_are_refused_and_old_readings_ignored(model, run):
    decoder = LiveDecoder(model, run.rest)
    with raises(LiveError, "channels-differ", count=2, expected=3):
        decoder(Reading(0.0, np.ones(2), 0.0))
    assert decoder(Reading(1.0, run.rest, 0.0)) is not None
    assert decoder(Reading(1.0, run.rest, 0.0)) is None
    with raises(LiveError, "channels-differ", count=2, expected=3):
        LiveDecoder(model, np.ones(2))


def test_swapped_plugs_are_reported_at_once_and_decoded_unswapped(model, run):
    def swap(t, ohms):
        return ohms[[2, 1, 0]] if 10 < t < 20 else ohms

    # Cords of different lengths, as in a device.
    run = replace(run, ohm=run.ohm * [1.0, 1.0, 0.3], rest=run.rest * [1.0, 1.0, 0.3])
    frames = play(LiveDecoder(model, run.rest), run, swap)
    on = [f for f in frames if 10.1 < f.time < 20]
    assert {f.quality for f in on} == {Quality.FALLBACK}
    note = on[0].notes[0]
    assert (note.code, note.data) == ("swapped", {"channels": ("left", "right")})
    whole = errors(play(LiveDecoder(model, run.rest), run), run)
    assert errors(frames, run) == pytest.approx(whole, abs=1.0)
    later = {f.quality for f in frames if f.time > 20.1}
    assert later <= {Quality.TRUSTED, Quality.UNTRAINED}


def test_plugs_swapped_before_the_start_are_reported_in_seconds(model, run):
    run = replace(run, ohm=run.ohm * [1.0, 1.0, 0.9], rest=run.rest * [1.0, 1.0, 0.9])
    frames = play(LiveDecoder(model, run.rest), run, lambda t, ohms: ohms[[2, 1, 0]])
    reported = [f.time for f in frames if any(n.code == "swapped" for n in f.notes)]
    assert reported
    assert reported[0] < 30


def test_implausible_readings_keep_the_last_shape(model, run):
    def absurd(t, ohms):
        return run.rest * [1.7, 0.4, 1.6] if t > 10 else ohms

    frames = play(LiveDecoder(model, run.rest), run, absurd)
    assert frames[-1].quality is Quality.LOST
    assert np.abs(frames[-1].markers - model.rest_points).max() < 60


def test_new_rest_is_not_a_movement_for_a_model_with_memory(model):
    model = replace(model, main=replace(model.main, past=Past((0.5, 20.0))))
    model = replace(model, gain=np.array([1.1, 0.9, 1.0]), offset=np.array([0.01, 0.0, -0.01]))
    stream, other = model.stream(), model.stream()
    before, after = np.array([1500.0, 1400.0, 900.0]), np.array([1560.0, 1390.0, 910.0])
    for k in range(200):
        ohms = before * (1 + 0.05 * np.sin(k / np.array([20.0, 30.0, 40.0])))
        stream.inputs(k / 60, ohms / before - 1)
        other.inputs(k / 60, ohms / after - 1)
    stream.change_rest(before / after)
    now, c = before / after - 1, 9
    assert stream.inputs(4.0, now)[:c] == pytest.approx(other.inputs(4.0, now)[:c], abs=1e-9)


def test_a_memory_of_movement_is_not_followed_as_drift(recorded):
    """Cords that tear and heal lie at rest for half a minute, after a minute of movement."""
    tear, healing_s = 0.3, 3.0  # as in the training
    model = train(recorded(240, tear=tear), TrainOptions(decoder="quadratic")).model
    assert model.main.past.count
    run = recorded(90, seed=5, noise=0.0).recordings[0]
    ideal = run.signals * np.clip(60.0 - run.sample_time, 0.0, 1.0)[:, None]
    torn = relaxed(run.sample_time, ideal, tear, healing_s)
    noise = 5e-4 * np.random.default_rng(3).normal(size=torn.shape)
    frames = play(LiveDecoder(model, run.rest), replace(run, ohm=run.rest * (1 + torn + noise)))
    last = np.array([frame.markers for frame in frames if frame.time > 85])
    offsets = np.linalg.norm(last - model.rest_points, axis=2)
    assert offsets.mean() < 1.3  # mm; 2.1 with signals of zero at rest


def test_swap_is_reported_while_it_lasts_with_memory(model, recorded, run):
    """Memories of swapped readings are wrong and must not be used."""
    r, past = recorded(120).recordings[0], Past((2.0, 40.0), (20.0,))
    seen = fit_trained_range(past(r.sample_time, r.signals), r.signals)
    watch = SwapWatch(replace(model, main=replace(model.main, past=past, range=seen)))
    rest = run.rest * [1.0, 0.8, 1.0]
    pairs = {}
    for t, ohm in zip(run.sample_time, run.ohm * [1.0, 0.8, 1.0], strict=True):
        watch(t, ohm[[1, 0, 2]] if 15 < t < 45 else ohm, rest)
        pairs[t] = watch.pair
    assert {pair for t, pair in pairs.items() if 15.2 < t < 45} == {(0, 1)}
    assert {pair for t, pair in pairs.items() if not 14.9 < t < 45.2} == {None}


def test_range_of_signals_equals_that_of_a_training_without_memory(recorded):
    dataset = recorded(240, tear=0.2)
    whole = train(dataset, TrainOptions(decoder="quadratic")).model.main.range
    alone = train(dataset, TrainOptions(decoder="quadratic", memory=False)).model.main.range
    signals = dataset.recordings[0].signals[::50]
    ratio = whole.for_signals().distance(signals) / alone.distance(signals)
    assert np.std(np.log(ratio)) < 0.05
