"""Small tables of a made-up sensor: signals that follow an angle and a force, with noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from defsense_fab.core.arrays import Float


def movements(time: Float, seed: int) -> tuple[Float, Float]:
    """Return an angle (n,), deg, and a force (n,), N, that never repeat."""
    rng = np.random.default_rng(seed)
    waves = [
        sum(
            np.sin(2 * np.pi * f * time + p)
            for f, p in zip(rng.uniform(0.1, 0.6, 4), rng.uniform(0, 6, 4), strict=True)
        )
        for _ in range(2)
    ]
    return 15 * waves[0], waves[1]


def write(path: Path, header: str, *columns: Float) -> Path:
    """Write a table; NaN becomes an empty cell."""
    rows = [",".join("" if np.isnan(x) else f"{x:.7g}" for x in row) for row in zip(*columns)]  # noqa: B905
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def ohms(time: Float, seed: int) -> Float:
    """Return the resistances (n, 2), ohm, of two channels of the sensor."""
    angle, force = movements(time, seed)
    noise = np.random.default_rng(seed + 100).normal(size=(len(time), 2))
    clean = np.stack([1000 + 8 * angle + 5 * force, 2000 - 5 * angle + 60 * force], axis=1)
    return np.asarray(clean + noise)


def write_pair(
    folder: Path,
    name: str = "run",
    *,
    seed: int = 0,
    seconds: float = 60.0,
    signals: str = "time,a_ohm,b_ohm",
    targets: str = "time,angle_deg,force_N",
    units: tuple[float, float] = (1.0, 1.0),
) -> tuple[Path, Path]:
    """Write signals at 25 Hz and targets at 20 Hz, divided by `units` (ohm and deg per unit)."""
    time, frames = np.arange(0, seconds, 0.04), np.arange(0, seconds, 0.05)
    R = ohms(time, seed) / units[0]
    angle, force = movements(frames, seed)
    return (
        write(folder / f"{name}.csv", signals, time, *R.T),
        write(folder / f"{name}-truth.csv", targets, frames, angle / units[1], force),
    )
