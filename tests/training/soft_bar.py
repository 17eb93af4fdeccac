"""A bar with three cords that bends and twists, and models trained on it."""

from dataclasses import replace

import numpy as np

from defsense_fab.decoding.ridge import affine_features, fit_ridge, quadratic_features
from defsense_fab.decoding.signal_history import Past
from defsense_fab.decoding.trained_model import Branch, Intervals, TrainedModel, TrainedRange
from defsense_fab.training.data.dataset import Dataset, Recording

IDS = np.array([3, 5, 7, 11, 13, 17])
CHANNELS = ("upper", "lower", "side")
REST = np.array([[x, y, 15.0] for x in (30.0, 75.0, 120.0) for y in (-12.0, 12.0)])
R0 = np.array([1000.0, 1200.0, 800.0])
#: Relative changes of resistance by bend (of the tip, mm) and twist (rad).
SLOPES = np.array([[0.004, 0.05], [-0.004, 0.06], [0.001, -0.12]])


def points_of(bend, twist):
    """Return marker positions (t, m, 3) for bend and twist (t,), of second order in the twist."""
    along = (REST[:, 0] / 150) ** 2
    out = np.repeat(REST[None], len(bend), axis=0)
    angle = twist[:, None] * REST[:, 0] / 150
    out[..., 1] = REST[:, 1] * np.cos(angle) - REST[:, 2] * np.sin(angle)
    out[..., 2] = REST[:, 1] * np.sin(angle) + REST[:, 2] * np.cos(angle) + bend[:, None] * along
    return out


def course(time, seed=0):
    """Return bend and twist (t,) of smooth poses, and the requested poses."""
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0, 2 * np.pi, 3)
    bend = 20 * np.sin(0.9 * time + phase[0]) * (0.6 + 0.4 * np.sin(0.13 * time + phase[1]))
    twist = 0.5 * np.sin(0.7 * time + phase[2])
    turn = (time // 10).astype(int) % 3  # bend, twist, both
    ease = np.minimum(np.minimum(time % 10, 10 - time % 10), 1)
    poses = tuple(
        (float(at), ("bend", "twist", "bend and twist")[int(at // 10) % 3])
        for at in np.arange(0, time[-1], 10)
    )
    return bend * ease * (turn != 1), twist * ease * (turn != 0), poses


def recording(
    seconds=60.0,
    seed=0,
    *,
    noise=0.0,
    sigma=0.0,
    gaps=0.0,
    memory=0.0,
    drift=0.0,
    gain=(1.0, 1.0, 1.0),
    name="run-1",
):
    """Return a run with 30 frames and 50 samples per second.

    `memory` is the share of a Maxwell element of 1 s in the signals; `drift` is the change of the
    signals until the end.
    """
    rng = np.random.default_rng(1000 + seed)
    ts = np.arange(0, seconds, 0.02)
    time = np.arange(0.05, seconds - 0.05, 1 / 30)
    bend, twist, _ = course(ts, seed)
    s = np.stack([bend, twist], axis=1) @ SLOPES.T
    if memory:
        s = s + memory * Past((1.0,))(ts, s)[:, 3:]
    s = s * gain + drift * (ts / seconds)[:, None] + noise * rng.normal(size=s.shape)
    bend, twist, poses = course(time, seed)
    points = points_of(bend, twist)
    points = points + sigma * rng.normal(size=points.shape)
    points[rng.random(points.shape[:2]) < gaps] = np.nan
    return Recording(
        name,
        "session-1",
        "unit-1",
        ts,
        R0 * (1 + s),
        R0,
        time,
        points,
        np.full(points.shape, sigma or np.nan),
        0.004,
        poses,
    )


def dataset(*recordings):
    return Dataset("bar", "abc", CHANNELS, IDS, REST, recordings or (recording(),))


def trained(data, features=affine_features, past=None, noise=1e-4):
    """Return a model of the first recording, with intervals valid for its training data."""
    r = data.recordings[0]
    past = past or Past()
    everything = Branch((0, 1, 2), past, None, None, None)
    z = np.stack(
        [
            np.interp(r.time, r.sample_time, column)
            for column in everything.inputs(r.sample_time, r.signals).T
        ],
        axis=1,
    )
    own = r.visible.all(1)
    decoder = fit_ridge(features(z.shape[1]), z[own], r.points[own].reshape(own.sum(), -1), noise)
    value, turn = np.linalg.eigh(np.cov(z[own].T) + 1e-9 * np.eye(z.shape[1]))
    signals = z[:, :3]
    within = TrainedRange(
        z[own].mean(0), turn / np.sqrt(value), 1.0, signals.min(0), signals.max(0)
    )
    within = replace(within, usual=float(np.quantile(within.distance(z[own]), 0.99)))
    miss = np.linalg.norm(decoder(z).reshape(len(z), -1, 3) - r.points, axis=2)
    intervals = Intervals(0.9, np.nanquantile(miss, 0.9, axis=0), 1.0)
    return TrainedModel(
        "bar",
        "abc",
        "affine",
        data.channels,
        data.ids,
        data.rest_points,
        np.ones(3),
        np.zeros(3),
        Branch((0, 1, 2), past, decoder, within, intervals),
    )


__all__ = ["affine_features", "quadratic_features"]
