"""Training as a whole, on a synthetic device."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sklearn.linear_model import Ridge

from defsense_fab.core.errors import TrainingError
from defsense_fab.training.data.dataset import Dataset
from defsense_fab.training.fitting.train_model import CandidateResult, Training, train
from defsense_fab.training.options import TrainOptions
from defsense_fab.training.regression.frames import Frames, split_frames
from defsense_fab.training.regression.weighted_ridge import INPUT_NOISES
from tests.support.errors import raises

from ..conftest import Maker

pytestmark = pytest.mark.slow


def changed(dataset: Dataset, **changes: object) -> Dataset:
    """Return the dataset with its one recording changed."""
    run = replace(dataset.recordings[0], **changes)  # type: ignore[arg-type]
    return replace(dataset, recordings=(run,))


def candidate(result: Training, name: str) -> CandidateResult:
    return next(c for c in result.candidates if c.name == name)


def test_the_affine_decoder_agrees_with_scikit_learn(recorded: Maker) -> None:
    dataset = recorded(60)
    result = train(dataset, TrainOptions(decoder="affine", memory=False))
    row = result.candidates[0]
    frames, _ = split_frames(Frames.from_dataset(dataset))
    x = frames.inputs(result.model.main.past, range(3))
    peer = Ridge(alpha=row.lambda_**2, solver="cholesky", tol=1e-12)
    peer.fit(x, frames.points.reshape(len(x), -1))
    decoder = result.model.main.decoder
    np.testing.assert_allclose(decoder.weights, peer.coef_.T, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(decoder.constant, peer.intercept_, rtol=1e-9, atol=1e-9)


def test_nonlinear_signals_select_a_nonlinear_decoder(recorded: Maker) -> None:
    result = train(recorded(60, noise=0.0))
    rmse = {a.name: a.test.rmse for a in result.candidates if a.test}
    assert result.selected in ("quadratic", "kernel")
    assert rmse["quadratic"] < 0.5 * rmse["affine"]
    expected = pytest.approx(rmse["quadratic"], rel=0.5)
    assert candidate(result, "quadratic").cross_validated == expected


def test_cords_that_relax_select_a_memory(recorded: Maker) -> None:
    result = train(recorded(180, tear=0.3, noise=2e-3))
    best = candidate(result, result.selected)
    static = min(a.test.rmse for a in result.candidates if a.test and not (a.moved or a.worked))
    assert best.moved or best.worked
    assert best.test is not None
    assert best.test.rmse < 0.8 * static


def test_cords_without_memory_select_no_memory(recorded: Maker) -> None:
    result = train(recorded(180, noise=0.0))
    assert result.selected in ("quadratic", "kernel")


def test_intervals_hold_on_later_frames(recorded: Maker) -> None:
    inside = []
    for seed in range(4):
        dataset = recorded(200, seed=seed, noise=2e-3, tear=0.1)
        result = train(dataset, TrainOptions(decoder="quadratic", memory=False))
        run, later = dataset.recordings[0], result.test_frames.frame_index
        found = result.model.decode(run.sample_time, run.signals, run.time[later])
        off = np.linalg.norm(found.points - run.points[later], axis=2)
        inside.append((off <= found.radius).mean())
    assert 0.88 < np.mean(inside) < 0.95  # few blocks give wide intervals


def test_fallback_decoders_do_not_use_the_lost_channel(recorded: Maker) -> None:
    dataset = recorded(60)
    model = train(dataset, TrainOptions(decoder="quadratic", memory=False)).model
    run = dataset.recordings[0]
    torn = run.signals.copy()
    torn[:, 1] = np.nan
    found = model.decode(run.sample_time, torn, run.time, lost="top")
    with_all = model.decode(run.sample_time, run.signals, run.time)
    assert np.isfinite(found.points).all()
    assert found.radius.mean() > 2 * with_all.radius.mean()
    with pytest.raises(TrainingError):
        model.branch("bottom")


def test_a_stream_decodes_like_the_batch(recorded: Maker) -> None:
    dataset = recorded(60, tear=0.3)
    model = train(dataset, TrainOptions(decoder="quadratic")).model
    run = dataset.recordings[0]
    when, signals = run.sample_time[:200], run.signals[:200]
    stream = model.stream()
    one = np.array([stream(t, s) for t, s in zip(when, signals, strict=True)])
    np.testing.assert_allclose(one, model.decode(when, signals, when).points, atol=1e-9)


@pytest.mark.parametrize("decoder", ["quadratic", "kernel"])
def test_far_from_the_training_a_model_decodes_like_the_affine_one(
    recorded: Maker, decoder: str
) -> None:
    dataset = recorded(60)
    models = [
        train(dataset, TrainOptions(decoder=kind, memory=False, weighted=False)).model
        for kind in (decoder, "affine")
    ]
    time = np.arange(3.0)
    middle = models[0].main.range.middle
    for factor, difference in ((1.0, 5.0), (1e3, 1e-2)):
        signals = np.tile(middle + factor * (models[0].main.range.high - middle), (3, 1))
        nonlinear, affine = (m.decode(time, signals, time).points - m.rest_points for m in models)
        assert np.abs(nonlinear - affine).max() < difference * np.abs(affine).max()
        stream = models[0].stream()
        one = np.array([stream(t, s) for t, s in zip(time, signals, strict=True)])
        np.testing.assert_allclose(one - models[0].rest_points, nonlinear, rtol=1e-9, atol=1e-9)


def test_wrong_markers_do_not_affect_the_others(recorded: Maker) -> None:
    clean = recorded(60)
    run = clean.recordings[0]
    rng = np.random.default_rng(0)
    wrong = rng.random(run.points.shape[:2]) < 0.15
    points = run.points.copy()
    points[wrong] += [30.0, 10.0, -20.0]
    points[300:304] += 25.0  # frames aligned wrongly to the rest pose
    dirty = changed(clean, points=points)
    after = split_frames(Frames.from_dataset(clean))[1].frame_index

    def error(options: TrainOptions) -> float:
        found = train(dirty, options).model.decode(run.sample_time, run.signals, run.time[after])
        return float(np.sqrt(((found.points - run.points[after]) ** 2).sum(2).mean()))

    good = next(a.test.rmse for a in train(clean).candidates if a.name == "quadratic" and a.test)
    assert error(TrainOptions(decoder="quadratic")) < 1.05 * good
    assert error(TrainOptions(decoder="quadratic", weighted=False)) > 10 * good
    result = train(dirty)
    hit = result.wrong_markers & (
        wrong[result.training_frames.frame_index]
        | (np.abs(result.training_frames.frame_index - 301.5) < 2)[:, None]
    )
    assert (
        hit.sum()
        == result.wrong_markers.sum()
        > 0.98 * wrong[result.training_frames.frame_index].sum()
    )


def test_long_decoder_errors_are_not_wrong_markers(recorded: Maker) -> None:
    dataset = recorded(60)
    run = dataset.recordings[0]
    ohm = run.ohm.copy()
    ohm[600:900] *= 1.02  # an error of the cords, not of the cameras
    assert not train(changed(dataset, ohm=ohm)).wrong_markers.any()


def test_uncertain_markers_have_smaller_weights(recorded: Maker) -> None:
    """Most frames are of a poor camera; weights by its stated uncertainty reduce the error."""
    dataset = recorded(120, sigma=0.02)
    run = dataset.recordings[0]
    rng = np.random.default_rng(1)
    poor = rng.random(len(run.time)) < 0.7
    points = run.points + np.where(poor[:, None, None], 4.0, 0.0) * rng.normal(
        size=run.points.shape
    )
    sigma = np.broadcast_to(np.where(poor[:, None, None], 4.0, 0.02), points.shape)
    noisy = changed(dataset, points=points, sigma=np.array(sigma))

    def error(weighted: bool) -> float:
        options = TrainOptions(decoder="kernel", memory=False, weighted=weighted)
        found = train(noisy, options).model.decode(run.sample_time, run.signals, run.time[-900:])
        return float(np.sqrt(((found.points - run.points[-900:]) ** 2).sum(2).mean()))

    assert error(True) < 0.85 * error(False)


def test_gaps_and_lost_samples_are_left_out(recorded: Maker) -> None:
    dataset = recorded(60, gaps=0.3)
    run = dataset.recordings[0]
    ohm = run.ohm.copy()
    ohm[1000:1200] = np.nan
    result = train(changed(dataset, ohm=ohm))
    lost = (
        np.abs(run.time[result.training_frames.frame_index] - run.sample_time[1100])
        < 100 / 60 - 0.02
    )
    assert not lost.any()
    assert next(a.test.rmse for a in result.candidates if a.name == "quadratic" and a.test) < 0.4


def test_too_few_frames_are_refused(recorded: Maker) -> None:
    with raises(TrainingError, "too-few-frames", count=29, needed=50):
        train(recorded(1.0))
    assert len(train(recorded(3.0), TrainOptions(memory=False)).training_frames) > 50


def test_a_marker_without_frames_is_refused(recorded: Maker) -> None:
    dataset = recorded(20)
    points = dataset.recordings[0].points.copy()
    points[:, 4] = np.nan
    with raises(TrainingError, "marker-rarely-seen", markers=(4,)):
        train(changed(dataset, points=points))


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"decoder": "neural"}, "unknown-choice"),
        ({"folds": 1}, "out-of-range"),
        ({"test_share": 1.0}, "out-of-range"),
        *(({"level": level}, "out-of-range") for level in (0.0, 1.0, 90.0, float("nan"))),
    ],
)
def test_invalid_options_are_refused(options: dict[str, object], code: str) -> None:
    with raises(TrainingError, code):
        TrainOptions(**options)  # type: ignore[arg-type]


def runs_of(dataset: Dataset, count: int, seconds: float = 5.0) -> Dataset:
    """Cut a dataset into runs of equal length, with pauses between them."""
    run = dataset.recordings[0]
    out = []
    for k in range(count):
        ends = run.time[-1] * k / count, run.time[-1] * (k + 1) / count
        at = (run.time >= ends[0]) & (run.time < ends[1])
        samples = (run.sample_time >= ends[0] - 0.1) & (run.sample_time < ends[1] + 0.1)
        out.append(
            replace(
                run,
                name=f"run-{k + 1}",
                sample_time=run.sample_time[samples] + seconds * k,
                ohm=run.ohm[samples],
                time=run.time[at] + seconds * k,
                points=run.points[at],
                sigma=run.sigma[at],
            )
        )
    return replace(dataset, recordings=tuple(out))


def test_intervals_do_not_depend_on_the_number_of_runs(recorded: Maker) -> None:
    """Cutting frames into runs does not make them independent."""
    dataset = recorded(240, noise=2e-3)
    options = TrainOptions(decoder="affine", memory=False)
    one, three = (train(d, options).model.main.intervals for d in (dataset, runs_of(dataset, 3)))
    assert one is not None
    assert three is not None
    np.testing.assert_allclose(three.radius, one.radius, rtol=0.15)


def test_a_run_that_starts_without_signals_is_used(recorded: Maker) -> None:
    dataset = runs_of(recorded(120, tear=0.3, noise=2e-3), 2)
    second = dataset.recordings[1]
    ohm = second.ohm.copy()
    ohm[:10, 1] = np.nan
    late = replace(dataset, recordings=(dataset.recordings[0], replace(second, ohm=ohm)))
    assert np.isfinite(train(late).candidates[-1].cross_validated)


def test_short_circuits_are_ignored(recorded: Maker) -> None:
    dataset = recorded(60)
    run = dataset.recordings[0]
    ohm = run.ohm.copy()
    ohm[500:560, 0] = 0.0
    ohm[700:760, 1] = np.inf
    found, clean = train(changed(dataset, ohm=ohm)), train(dataset)
    assert found.candidates[0].cross_validated < 1.1 * clean.candidates[0].cross_validated
    assert found.model.faults is not None
    assert clean.model.faults is not None
    np.testing.assert_allclose(found.model.faults.low, clean.model.faults.low, atol=0.02)


def test_candidates_are_compared_by_the_same_measure(recorded: Maker) -> None:
    """Uncertain frames affect the errors of all candidates alike."""
    dataset = recorded(60)
    run = dataset.recordings[0]
    rng = np.random.default_rng(1)
    poor = np.where(rng.random(len(run.time)) < 0.5, 4.0, 0.05)[:, None, None]
    points = run.points + poor * rng.normal(size=run.points.shape)
    result = train(
        changed(dataset, points=points, sigma=np.broadcast_to(poor, points.shape).copy()),
        TrainOptions(memory=False),
    )
    rows = {a.name: a.cross_validated for a in result.candidates}
    assert rows["affine"] < 1.5 * rows["quadratic"] + 1.0


def test_short_folds_are_refused(recorded: Maker) -> None:
    dataset = recorded(20)
    with raises(TrainingError, "folds-too-short", largest=6):
        train(dataset, TrainOptions(folds=60))
    with raises(TrainingError, "too-few-frames", needed=50):
        train(dataset, TrainOptions(test_share=0.95))


def test_fallback_decoders_of_the_affine_map_are_unweighted(recorded: Maker) -> None:
    dataset = recorded(60)
    run = dataset.recordings[0]
    sigma = np.random.default_rng(0).uniform(0.02, 2.0, run.points.shape)
    result = train(changed(dataset, sigma=sigma), TrainOptions(decoder="affine", memory=False))
    x = result.training_frames.inputs(result.model.main.past, [0, 2])
    o = result.training_frames.points.reshape(len(x), -1)
    best = min(
        (Ridge(alpha=len(x) * s**2, solver="cholesky").fit(x, o) for s in INPUT_NOISES),
        key=lambda r: np.abs(r.coef_.T - result.model.without["top"].decoder.weights).max(),
    )
    np.testing.assert_allclose(
        best.coef_.T, result.model.without["top"].decoder.weights, rtol=1e-7, atol=1e-7
    )
