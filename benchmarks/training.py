"""Train on simulated built devices, whose behavior no decoder and no design assumes.

    python -m benchmarks.training my-device
    python -m benchmarks.training fixtures/devices/bar --seeds 5 --minutes 10 --few --later

Each device is built up to its layout. Each seed is another built unit with another hand movement.
The output shows for each seed:

- RMSE (mm) on the last 30 % of the paper's affine decoder, of the best static decoder and of the
  chosen one, next to the predicted error and its band; peak and average peak of the chosen decoder;
  its error by cross-validation;
- the share of marker positions inside of their 90 % intervals, over all and in the worst pose, and
  the mean radius of the intervals;
- the error predicted from design and training, of the chosen decoder and of the best without
  memory, its ratio to the measured error and that of the design's prediction, and all mean squares
  (mm^2) that the prediction consists of.

`--few` trains on less data: none but the simulation, 60 frames of the first minute, 5 minutes; each
with and without the simulation, by RMSE on the same last 30 %. `--later` decodes a session of the
same unit 20 hours later: as it is, and with the gain of each cord changed by a fifth. Its last 30 %
are decoded after a recalibration by one and by three rounds of three poses of the frames before,
too. `--units` decodes the last 30 % of the first session by models of other units: of one (seeds +
1) and of two (and seeds + 2), trained on the first 70 % of each, as they are and after a routine of
20 seconds. `--cords` chooses the family of the twin's cords.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import get_args

import numpy as np

from defsense_fab.core.arrays import Float
from defsense_fab.core.device.build_folder import build_folder
from defsense_fab.core.device.device import Device
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import TrainingError
from defsense_fab.decoding.trained_model import TrainedModel
from defsense_fab.store.layout import LayoutRecord, load_layout
from defsense_fab.training.data.dataset import Dataset, Recording
from defsense_fab.training.evaluation.decoded_frames import decode_frames
from defsense_fab.training.evaluation.predicted_error import design_prediction, predict_error
from defsense_fab.training.fitting.pose_signals import list_pose_samples
from defsense_fab.training.fitting.prepare import simulated_prior
from defsense_fab.training.fitting.recalibration import recalibrate
from defsense_fab.training.fitting.train_model import Training, train
from defsense_fab.training.options import TrainOptions
from defsense_fab.training.regression.simulated_decoder import fit_simulated_model
from defsense_fab.twin.options import CordFamilyName, TwinOptions
from defsense_fab.twin.recordings.twin_recordings import simulate_runs
from defsense_fab.workflow.build.build import build

_TEST = 0.3


def select_frames(dataset: Dataset, keep: slice) -> Dataset:
    """Return the dataset with some of the frames of its first recording."""
    r = dataset.recordings[0]
    part = replace(r, time=r.time[keep], points=r.points[keep], sigma=r.sigma[keep])
    return replace(dataset, recordings=(part,))


def errors(model: TrainedModel, r: Recording, frames: slice) -> tuple[Float, Float]:
    """Return distances (t, m) mm from the measured markers, and the radius of the intervals."""
    trained = model.decode(r.sample_time, r.signals, r.time[frames])
    return np.linalg.norm(trained.points - r.points[frames], axis=2), trained.radius


def rmse(distance: Float) -> float:
    """Return the RMS of distances."""
    return float(np.sqrt(np.nanmean(distance**2)))


def by_pose(r: Recording, frames: slice, inside: Float) -> dict[str, float]:
    """Return the share of positions inside of their intervals, by pose."""
    out: dict[str, list[Float]] = {}
    time = r.time[frames]
    ends = [*(t for t, _ in r.poses[1:]), np.inf]
    for (begin, name), end in zip(r.poses, ends, strict=False):
        out.setdefault(name, []).append(inside[(time >= begin) & (time < end)].ravel())
    joined = {name: np.concatenate(parts) for name, parts in out.items()}
    return {name: float(np.nanmean(x)) for name, x in joined.items() if np.isfinite(x).sum() > 500}


def device_rows(device: Device, options: argparse.Namespace) -> None:
    """Print the results of a device."""
    layout = load_layout(build_folder(device))
    promised = layout.unseen[layout.prediction.decoder]
    band = layout.band
    print(f"{device.name}: predicted {promised:.2f} mm ({band.low:.2f}-{band.high:.2f})")
    others = train_other_units(device, options) if options.units else {}
    for seed in range(1, options.seeds + 1):
        sessions = simulate_unit(device, options, seed)
        whole = replace(sessions, recordings=sessions.recordings[:1])
        prior = simulated_prior(device, whole.channels, whole.rest_points)
        result = train(whole, prior=prior)
        r = whole.recordings[0]
        after = slice(int(result.test_frames.frame_index[0]), len(r.time))
        distance, radius = errors(result.model, r, after)
        print_errors(
            seed,
            result,
            distance,
            radius,
            by_pose(r, after, np.where(np.isfinite(distance), distance <= radius, np.nan)),
        )
        print_predictions(layout, result, whole)
        if options.few:
            few(whole, result, prior, after)
        if options.later:
            later(result.model, sessions.recordings[1])
        for title, other in others.items():
            text = recalibrated(other.model, r, after, 1, 20 / (1 + min(3, len(other.model.poses))))
            print(f"    {title} ({other.selected}), last 30 %: {text}", flush=True)


def simulate_unit(device: Device, options: argparse.Namespace, unit: int) -> Dataset:
    """Return one session of a built unit, or two if the second is decoded too."""
    twin = TwinOptions(
        minutes=options.minutes,
        sessions=2 if options.later else 1,
        seed=unit,
        unit=unit,
        cords=options.cords,
    )
    return simulate_runs(device, twin).dataset


def train_other_units(device: Device, options: argparse.Namespace) -> dict[str, Training]:
    """Return models of one and of two other units, trained on the first 70 % of a session each."""
    parts = []
    for unit in (options.seeds + 1, options.seeds + 2):
        dataset = simulate_unit(device, options, unit)
        cut = _first_tested(dataset.recordings[0])
        part = select_frames(dataset, slice(0, cut)).recordings[0]
        parts.append(replace(part, name=f"run-{unit}", session=f"session-{unit}"))
    prior = simulated_prior(device, dataset.channels, dataset.rest_points)
    return {
        title: train(
            replace(dataset, recordings=tuple(parts[:count])),
            TrainOptions(test_share=0.0),
            prior=prior,
        )
        for count, title in ((1, "model of another unit"), (2, "model of two units"))
    }


def print_errors(
    seed: int, result: Training, distance: Float, radius: Float, poses: dict[str, float]
) -> None:
    """Print the errors and intervals of a seed."""
    rows = {a.name: a for a in result.candidates}
    static = min(a.test.rmse for a in rows.values() if a.test and not (a.moved or a.worked))
    best = rows[result.selected]
    known = np.isfinite(distance)
    worst = min(poses, key=lambda p: poses[p])
    assert best.test is not None
    affine = rows["affine"].test
    assert affine is not None
    inside = (distance[known] <= radius[known]).mean()
    print(
        f"  seed {seed}: affine {affine.rmse:.2f}, static {static:.2f}, {result.selected}"
        f" {best.test.rmse:.2f} ± {best.test.per_state.std():.2f} (folds"
        f" {best.cross_validated:.2f}, peak {best.test.peak:.1f}, mean peak"
        f" {best.test.average_peak:.2f}); inside {inside:.1%}, least {poses[worst]:.1%} ({worst}),"
        f" radius {np.nanmean(radius):.2f}; {len(result.test_frames)} tested",
        flush=True,
    )


def print_predictions(layout: LayoutRecord, result: Training, whole: Dataset) -> None:
    """Print predicted and measured errors."""
    plain = train(whole, TrainOptions(decoder="quadratic", memory=False))
    for trained in (result, plain):
        if trained.repeatability is None:
            print(f"    {trained.selected}: no shape is shown twice")
            continue
        frames = decode_frames(trained.model, whole, _TEST)
        p = predict_error(
            trained.repeatability, frames, design_prediction(layout, trained.selected)
        )
        parts = ", ".join(f"{cause} {square:.3f}" for cause, square in p.shares.items())
        print(
            f"    {trained.selected}: predicted {p.predicted:.2f}, measured {p.measured:.2f}, ratio"
            f" {p.ratio:.2f} (the design alone {p.design_ratio:.2f}): {parts}",
            flush=True,
        )


def few(whole: Dataset, full: Training, prior, after: slice) -> None:  # type: ignore[no-untyped-def]
    """Print the errors of training on less data."""
    r = whole.recordings[0]
    goal = rmse(errors(full.model, r, after)[0])
    alone = fit_simulated_model(
        whole.device, whole.layout, whole.channels, whole.ids, whole.rest_points, prior
    )
    print(f"    no picture: {rmse(errors(alone, r, after)[0]):.2f}; all: {goal:.2f}")
    rate = 1 / float(np.median(np.diff(r.time)))
    cut = int(full.test_frames.frame_index[0])
    cases = {
        "60 pictures of the first minute": slice(0, round(60 * rate), round(rate)),
        "60 pictures of the training": slice(0, cut, cut // 60),
        "the first minute": slice(0, round(60 * rate)),
        "5 minutes": slice(0, round(300 * rate)),
    }
    for name, part in cases.items():
        text = []
        for p in (None, prior):
            try:
                model = train(
                    select_frames(whole, part), TrainOptions(test_share=0.0), prior=p
                ).model
                text.append(f"{rmse(errors(model, r, after)[0]):.2f}")
            except TrainingError as error:
                text.append(str(error)[:60])
        print(f"    {name}: {text[0]} without the simulation, {text[1]} with it", flush=True)


def later(model: TrainedModel, r: Recording) -> None:
    """Print the errors 20 hours later, and with the gain of a cord changed by a fifth."""
    every = slice(0, len(r.time), 10)
    last = slice(_first_tested(r), len(r.time))
    cases = [(k, gain) for k in range(len(model.channels)) for gain in (0.8, 1.2)]
    for k, gain in [(0, 1.0), *cases]:
        signals = r.signals.copy()
        signals[:, k] *= gain
        now = replace(r, ohm=r.rest * (1 + signals))
        distance, radius = errors(model, now, every)
        known_frames = np.isfinite(distance)
        inside = (distance[known_frames] <= radius[known_frames]).mean()
        title = "20 h later" if gain == 1 else f"{model.channels[k]} x {gain}"
        print(
            f"    {title}: {rmse(distance):.2f} mm, inside {inside:.1%}, radius"
            f" {np.nanmean(radius):.2f}; last 30 % {recalibrated(model, now, last, 1)};"
            f" {recalibrated(model, now, last, 3)}",
            flush=True,
        )


def recalibrated(
    model: TrainedModel, r: Recording, frames: slice, rounds: int, seconds: float = 9.0
) -> str:
    """Return the error in some frames, and that after a recalibration, as text."""
    text = f"{rmse(errors(model, r, frames)[0]):.2f}, re-calibrated by {rounds}"
    try:
        trained = recalibrate(model, [routine(r, model, rounds, seconds)])
    except TrainingError as error:
        return f"{text}: {error}"
    gains = ", ".join(
        f"{g:.2f} ± {e:.2f}" for g, e in zip(trained.gain, trained.gain_error, strict=True)
    )
    after = rmse(errors(trained.model, r, frames)[0])
    refused = " refused" if trained.problems else ""
    return f"{text}: {after:.2f} (gains {gains}, left {trained.residual:.1f}){refused}"


def routine(r: Recording, model: TrainedModel, rounds: int, seconds: float = 9.0) -> Recording:
    """Return a recalibration recording: rounds of up to three poses and a rest, a few seconds each.

    It starts after half a minute of movement, and ends before the frames that are tested. Of each
    pose the repetitions that go farthest are taken, because the simulated hand often stops before
    the full pose, and of these the last seconds, in which it has left the previous pose.
    """
    parts, marks, at = [], [], 0.0
    end = r.time[_first_tested(r)]
    warm = [
        (name, s)
        for name, s in list_pose_samples(r)
        if r.sample_time[s.start] > 30 and r.sample_time[s.stop - 1] < end
    ]
    poses = [n for n in model.poses if any(n == name for name, _ in warm)][:3]
    by_name = {}
    for name in (*poses, "rest"):
        shown = [_last_seconds(r, s, seconds) for n, s in warm if n == name]
        if name != "rest":
            shown.sort(key=partial(_reach, r, np.asarray(model.poses[name])), reverse=True)
        by_name[name] = shown[:rounds]
    for k in range(rounds):
        for name, each in by_name.items():
            if k >= len(each):
                continue
            time = r.sample_time[each[k]]
            marks.append((at, name))
            parts.append((time - time[0] + at, r.ohm[each[k]]))
            at += seconds + 0.1
    none = np.zeros((0, *r.points.shape[1:]))
    return replace(
        r,
        sample_time=np.concatenate([t for t, _ in parts]),
        ohm=np.concatenate([o for _, o in parts]),
        time=np.zeros(0),
        points=none,
        sigma=none,
        poses=tuple(marks),
    )


def _first_tested(r: Recording) -> int:
    """Return the index of the first frame of the test part."""
    return round((1 - _TEST) * len(r.time))


def _last_seconds(r: Recording, samples: slice, seconds: float) -> slice:
    """Return the part of some samples that is in their last seconds."""
    start = np.searchsorted(r.sample_time, r.sample_time[samples.stop - 1] - seconds)
    return slice(max(samples.start, int(start)), samples.stop)


def _reach(r: Recording, expected: Float, samples: slice) -> float:
    """Return how far the signals of a pose go, in units of those expected.

    The first second is left out, in which the hand still leaves the previous pose.
    """
    late = r.sample_time[samples] > r.sample_time[samples.start] + 1
    return float(np.nanmax(r.signals[samples][late] @ expected) / (expected @ expected))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("devices", nargs="+", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--few", action="store_true")
    parser.add_argument("--cords", default=TwinOptions.cords, choices=get_args(CordFamilyName))
    parser.add_argument("--later", action="store_true")
    parser.add_argument("--units", action="store_true")
    options = parser.parse_args()
    for folder in options.devices:
        device = load_device(folder)
        build(device, "optimize")
        device_rows(device, options)


if __name__ == "__main__":
    main()
