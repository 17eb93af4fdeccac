"""Compare training with scikit-learn, with the same folds, and measure one decoded sample.

    python -m benchmarks.train
    python -m benchmarks.train --minutes 10 60 --markers 40
    python -m benchmarks.train --minutes 10 --channels 4 16 64 --markers 20 [--profile]

The data are smooth, noisy signals of three cords at 60 Hz and markers at 30 Hz. `affine`: five
contiguous folds select the ridge weight, by this project and by scikit-learn's RidgeCV, which gets
the same features, folds and weights. RidgeCV fits again for each; its fastest way, leave-one-out by
singular values, has no folds. `all decoders`: every decoder that `defsense train` tries, with time
constants and intervals. Times are CPU seconds, medians of alternating rounds.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import time
from collections.abc import Callable
from statistics import median

import numpy as np
from scipy.interpolate import CubicSpline
from sklearn.linear_model import RidgeCV
from sklearn.model_selection import PredefinedSplit

from defsense_fab.core.arrays import Float
from defsense_fab.core.machine.processes import one_blas_thread
from defsense_fab.decoding.signal_history import Past
from defsense_fab.training.data.dataset import Dataset, Recording
from defsense_fab.training.fitting.decoder_selection import FitData, fit_candidate
from defsense_fab.training.fitting.train_model import train
from defsense_fab.training.regression.candidates import AFFINE, Candidate
from defsense_fab.training.regression.frames import Frames, assign_folds, split_frames
from defsense_fab.training.regression.weighted_ridge import INPUT_NOISES


def make_recording(minutes: float, markers: int, seed: int = 0) -> Dataset:
    """Return the recording of a device that moves smoothly in three dimensions."""
    rng = np.random.default_rng(seed)
    when = np.arange(0, 60 * minutes, 1 / 60)
    knots = np.arange(int(when[-1] / 2) + 3) * 2.0
    levels = np.tanh(CubicSpline(knots, rng.uniform(-1, 1, (len(knots), 3)))(when))
    signals = 0.1 * levels + 0.02 * levels[:, [1, 2, 0]] * levels
    ohm = 1500 * (1 + signals + 2e-3 * rng.normal(size=signals.shape))
    at = np.arange(0.02, when[-1], 1 / 30)
    now = np.stack([np.interp(at, when, x) for x in levels.T], axis=1)
    rest = rng.uniform(-50, 50, (markers, 3))
    points = rest + np.tensordot(now, 8 * rng.normal(size=(3, markers, 3)), 1)
    points += 0.1 * rng.normal(size=points.shape)
    unknown = np.full(points.shape, np.nan)
    run = Recording("run-1", "s", "1", when, ohm, np.full(3, 1500.0), at, points, unknown)
    return Dataset("toy", "", ("a", "b", "c"), np.arange(markers), rest, (run,))


def make_mixture(minutes: float, markers: int, channels: int, seed: int = 0) -> Dataset:
    """Return the recording of a device whose channels mix four movements, nonlinearly."""
    rng = np.random.default_rng(seed)
    when, at = np.arange(0, 60 * minutes, 0.01), np.arange(0, 60 * minutes, 1 / 30)
    knots = np.arange(0, 60 * minutes + 5, 1.5)
    levels = rng.uniform(-1, 1, (4, len(knots)))
    sampled, shown = (np.stack([np.interp(t, knots, x) for x in levels], 1) for t in (when, at))
    mixed = sampled @ rng.normal(size=(4, channels))
    signals = 0.1 * mixed + 0.02 * mixed**2 + 1e-3 * rng.normal(size=mixed.shape)
    rest = 30 * rng.normal(size=(markers, 3))
    directions = 5 * rng.normal(size=(4, markers * 3))
    points = rest + (shown @ directions + 0.3 * shown**2 @ directions).reshape(-1, markers, 3)
    points += 0.2 * rng.normal(size=points.shape)
    sigma = np.full(points.shape, 0.2) * rng.uniform(0.5, 2, (*points.shape[:2], 1))
    reference = np.full(channels, 1000.0)
    run = Recording("run-1", "s", "1", when, 1000 * (1 + signals), reference, at, points, sigma)
    names = tuple(f"c{k}" for k in range(channels))
    return Dataset("toy", "", names, np.arange(markers), rest, (run,))


def whole(minutes: float, markers: int, channels: int, *, has_profile: bool) -> None:
    """Print CPU seconds and elapsed time of `train` with many channels."""
    dataset, profile = make_mixture(minutes, markers, channels), cProfile.Profile()
    start, started_cpu = time.perf_counter(), time.process_time()
    with one_blas_thread():  # as `defsense train` does
        training = profile.runcall(train, dataset) if has_profile else train(dataset)
    cpu_s, elapsed_s = time.process_time() - started_cpu, time.perf_counter() - start
    chosen = next(c for c in training.candidates if c.name == training.selected)
    print(
        f"{minutes:g} min, {channels} channels, {markers} markers,"
        f" {len(dataset.recordings[0].time)} frames: {cpu_s:.1f} CPU s, {elapsed_s:.1f} s elapsed;"
        f" {training.selected}, error {chosen.test.rmse if chosen.test else np.nan:.2f} mm",
        flush=True,
    )
    if has_profile:
        pstats.Stats(profile).sort_stats("cumtime").print_stats("defsense_fab|linalg|matmul", 25)
        pstats.Stats(profile).sort_stats("tottime").print_stats(12)


def cpu(work: Callable[[], object]) -> float:
    """Return the CPU seconds of a call."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def affine(dataset: Dataset, rounds: int) -> tuple[float, float]:
    """Return the CPU seconds of this project and of RidgeCV."""
    frames, _ = split_frames(Frames.from_dataset(dataset))
    x: Float = frames.inputs(Past(), range(3))
    outputs = frames.points - dataset.rest_points
    weights, fold = np.ones(outputs.shape[:2]), assign_folds(len(frames))
    data = FitData(frames, range(3), outputs, weights, fold)
    peer = RidgeCV(alphas=len(frames) * INPUT_NOISES**2, cv=PredefinedSplit(fold))

    def fit_ours() -> None:
        fit_candidate(Candidate(AFFINE, Past()), data).decoder()

    def fit_peer() -> None:
        peer.fit(frames.inputs(Past(), range(3)), outputs.reshape(len(x), -1))

    times = [(cpu(fit_ours), cpu(fit_peer)) for _ in range(rounds)]
    return median(a for a, _ in times), median(b for _, b in times)


def one_sample(dataset: Dataset) -> float:
    """Return the median elapsed time of the chosen decoder per sample, microseconds."""
    model = train(dataset).model
    r = dataset.recordings[0]
    stream, times_s = model.stream(), []
    for when, signals in zip(r.sample_time[:1200], r.signals[:1200], strict=True):
        begin = time.perf_counter()
        stream(float(when), signals)
        times_s.append(time.perf_counter() - begin)
    return 1e6 * median(times_s[200:])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, nargs="+", default=[10.0, 60.0])
    parser.add_argument("--markers", type=int, default=40)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--channels", type=int, nargs="+", default=[])
    parser.add_argument("--profile", action="store_true")
    options = parser.parse_args()
    train(make_recording(1.0, options.markers))  # compiles
    if options.channels:
        for minutes in options.minutes:
            for channels in options.channels:
                whole(minutes, options.markers, channels, has_profile=options.profile)
        return
    for minutes in options.minutes:
        dataset = make_recording(minutes, options.markers)
        ours, peer = affine(dataset, options.rounds)
        every = median(cpu(lambda d=dataset: train(d)) for _ in range(min(options.rounds, 3)))  # type: ignore[misc]
        print(
            f"{minutes:g} min, {len(dataset.recordings[0].time)} frames of {options.markers}"
            f" markers: affine {ours:.3f} s, RidgeCV {peer:.3f} s, ratio {ours / peer:.2f}; all"
            f" decoders {every:.1f} s; a sample {one_sample(dataset):.1f} us",
            flush=True,
        )


if __name__ == "__main__":
    main()
