"""How often a trained model tells a device's poses apart, on a session of a twin, whose poses are
known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float, Int
from ...core.device_file import load_device
from ...core.errors import LiveError
from ...runtime.controls.pose_amplitudes import PoseAmplitudes
from ...runtime.controls.pose_basis import PoseBasis
from ..live.live_device import live_device
from ..live.live_loop import deviation
from ..train.data.data_files import DataFiles
from ..train.evaluation.twin_truth import TRUTH
from ..train.models.prepare import NO, prepare

#: A picture shows a pose from this amplitude on, others being this share of it at most.
_SHOWN, _OTHERS = 0.5, 0.2


@dataclass(frozen=True)
class ToldApart:
    """Of `poses` by name the pictures (p, p) by the pose that is shown and that which is found."""

    poses: tuple[str, ...]
    counts: Int

    def __post_init__(self) -> None:
        if self.counts.shape != (len(self.poses),) * 2 or (self.counts < 0).any():
            raise LiveError(f"counts of {len(self.poses)} poses have the shape {self.counts.shape}")

    @property
    def share(self) -> float:
        """Of the pictures, 0 to 1, those in which the pose is found that is shown; NaN without
        any."""
        shown = int(self.counts.sum())
        return float(np.trace(self.counts) / shown) if shown else np.nan


def told_apart(model: Path, session: Path, device: Path, last_share: float = 0.3) -> ToldApart:
    """Of the last pictures of a twin's `session`, read by the `model` of the built `device`'s
    folder. Raises LiveError for a session of which the poses are not known, or a model of another
    device."""
    if not (session / TRUTH).exists():
        raise LiveError(f"{session}: has no {TRUTH}; only a twin's sessions know their poses")
    live = live_device(model, device)
    if live.poses is None:
        raise LiveError(f"{device}: is not built; run 'defsense build {device}'")
    with np.load(session / TRUTH) as truth:
        time = truth["time"]
        time = time[round((1 - last_share) * len(time)) :]
        names = truth["poses"].tolist()
        weights = np.array([np.interp(time, truth["sample_time"], w) for w in truth["weights"].T])
    r = prepare(DataFiles((session,)), load_device(device), wanted=NO)[0].recordings[0]
    found = live.model.decode(r.sample_time, r.signals, time)
    return count_poses(
        live.poses, found.points - live.model.rest_points, found.radius, names, weights.T,
        len(live.model.channels),
    )  # fmt: skip


def count_poses(
    poses: PoseBasis, moved: Float, radius: Float, names: Sequence[str], weights: Float,
    independent: int,
) -> ToldApart:  # fmt: skip
    """Of displacements `moved` (t, m, 3) mm that were read from so many `independent` signals, with
    the radius (t, m) mm of their 90 % intervals, while the poses `names` had `weights` (t, q)."""
    amplitudes, where = PoseAmplitudes(poses, independent), list(poses.names)
    counts = np.zeros((len(where), len(where)), np.int64)
    for u, wide, w in zip(moved, radius, weights, strict=True):
        values = amplitudes(u, deviation(wide)).values  # in every picture: each begins at the last
        least, most = np.sort(w)[-2:] if len(w) > 1 else (0.0, w[0])
        shown = names[int(w.argmax())]
        if most >= _SHOWN and least <= _OTHERS * most and shown in where:
            counts[where.index(shown), int(values.argmax())] += 1
    return ToldApart(tuple(where), counts)
