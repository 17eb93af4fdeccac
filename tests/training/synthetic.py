"""Recordings of a synthetic device: smooth random poses, and nonlinear cords that relax."""

from __future__ import annotations

import numpy as np

from defsense_fab.training.data.dataset import Dataset, Recording

CHANNELS = ("left", "middle", "right")
R0 = np.array([1200.0, 2100.0, 320.0])
IDS = np.array([1, 2, 5, 7, 8])
REST = np.array([[0.0, -12, 8], [30, 12, 8], [60, -12, 8], [90, 12, 8], [30, 0, -9]])
QUIET = 3.0  # s of rest at the start
GAIN = np.array([[0.10, -0.05, 0.03], [-0.04, 0.12, 0.05], [0.05, 0.03, -0.09]])
_STATES = np.random.default_rng(7).normal(size=(3, len(IDS), 3)) * [4, 8, 12]


def weights(time: np.ndarray, seed: int) -> np.ndarray:
    """Return weights of three poses (n, 3): they never repeat, and are 0 in the initial rest."""
    rng = np.random.default_rng(seed)
    out = np.zeros((len(time), 3))
    for k in range(3):
        for rate in rng.uniform(0.1, 0.9, 5):
            out[:, k] += np.sin(2 * np.pi * rate * time + rng.uniform(0, 6.3)) / 3
    return out * np.clip((time - QUIET) / 0.5, 0, 1)[:, None]


def places(time: np.ndarray, seed: int) -> np.ndarray:
    """Return marker positions (t, m, 3) mm; those of the anchor (1, 2 and 8) are fixed."""
    w = weights(time, seed)
    moved = np.einsum("tk,kmd->tmd", w, _STATES) + 2 * np.einsum("tk,kmd->tmd", w**2, _STATES) / 5
    moved[:, [0, 1, 4]] = 0
    return REST + moved


def signals(time: np.ndarray, seed: int) -> np.ndarray:
    """Return signals (n, 3), nonlinear in the poses; a fifth relaxes within 2 s."""
    fine = np.arange(0.0, time[-1] + 0.02, 0.01)
    s = weights(fine, seed) @ GAIN
    s = s + 0.6 * s**2
    slow = np.zeros_like(s)
    keep = np.exp(-0.01 / 2.0)
    for k in range(1, len(fine)):
        slow[k] = slow[k - 1] * keep + s[k] - s[k - 1]
    s = 0.8 * s + 0.2 * slow
    return np.stack([np.interp(time, fine, column) for column in s.T], axis=1)


def recording(
    seed: int = 1,
    seconds: float = 40.0,
    *,
    rate: float = 60.0,
    frames: float = 30.0,
    late: float = 0.0,
    noise: float = 1e-3,
    rest: np.ndarray = R0,
    session: str | None = None,
    unit: str = "unit-1",
) -> Recording:
    """Return one run, with signals that are `late` seconds late."""
    rng = np.random.default_rng(100 + seed)
    t, f = np.arange(0, seconds, 1 / rate), np.arange(0, seconds, 1 / frames)
    ohm = rest * (1 + signals(t, seed) + rng.normal(size=(len(t), 3)) * noise)
    points = places(f, seed) + rng.normal(size=(len(f), len(IDS), 3)) * 0.05
    points[rng.random(points.shape[:2]) < 0.02] = np.nan
    sigma = np.where(np.isfinite(points), 0.05, np.nan)
    session = session or f"session-{seed}"
    return Recording(
        f"{session}/run-1",
        session,
        unit,
        t + late,
        ohm,
        np.array(rest),
        f,
        points,
        sigma,
        0.003,
        ((0.0, "rest"), (QUIET, "bend")),
    )


def dataset(*recordings: Recording, **changed) -> Dataset:
    """Return a dataset of these recordings, or of two of 40 s."""
    whole = recordings or (recording(1), recording(2))
    given = {
        "device": "bar",
        "layout": "abc",
        "channels": CHANNELS,
        "ids": IDS,
        "rest_points": REST,
        "recordings": whole,
        "provenance": {"sessions": []},
    }
    return Dataset(**(given | changed))
