"""Compare tracks from unsynchronized cameras with late time stamps with the true movement.

    python -m tests.support.late_stamps                    # 10 seeds of each condition
    python -m tests.support.late_stamps --seeds 3 --seconds 20

Two cameras at 30 frames/s see twelve tags on an object that is moved by hand; corners have noise of
0.03 px. Each camera has its own phase and rate, its time stamps are late by the absolute value of a
normal distribution, and frames are lost. `left out` are frames that could not be combined, `late`
the median time error of the tracks (ms), `stated` two stated standard deviations, and `error` the
95th percentile (mm).
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from defsense_fab.capture.cameras.image_sources import measure_timing
from defsense_fab.capture.cameras.rig_file import Rig
from defsense_fab.capture.tags.detection import TagView
from defsense_fab.capture.tracking.observations import store_views
from defsense_fab.capture.videos.video_detection import VideoDetections
from defsense_fab.capture.videos.video_tracks import assemble
from defsense_fab.core.arrays import Float
from tests.capture.rigs import flat, rig, spread, tags

NOISE, TAGS, SIDE = 0.03, 12, 15.0


def move_corners(corners: Float, time: Float) -> Float:
    """Return corners (t, m, 4, 3) that are carried and turned by hand; at rest (m, 4, 3)."""
    by = 25 * np.sin(2 * np.pi * np.outer(time, [0.7, 1.1, 0.5]) + [0, 1, 2])
    angle = 0.3 * np.sin(2 * np.pi * 0.9 * time)
    c, s = np.cos(angle), np.sin(angle)
    R = np.stack([np.stack([c, -s, 0 * c], -1), np.stack([s, c, 0 * c], -1),
                  np.tile([0.0, 0, 1], (len(time), 1))], axis=1)  # fmt: skip
    middle = corners.mean(axis=(0, 1))
    return np.einsum("tij,mkj->tmki", R, corners - middle) + middle + by[:, None, None]


def trial(
    late: float, lost: float, drift: float, seconds: float, seed: int
) -> tuple[int, float, float, float]:
    """Return the number of excluded frames, the lag (ms), the stated error and the error (mm)."""
    rng = np.random.default_rng(seed)
    cameras, base = rig(2), tags(TAGS, rng)
    watched, true = [], []
    for k, camera in enumerate(cameras):
        step = (1 + (drift if k else 0.0)) / 30
        at = rng.uniform(0, 1 / 30) + step * np.arange(round(30 * seconds))
        at = at[rng.random(len(at)) >= lost]
        moved_corners = move_corners(base, at)
        px = flat(camera, moved_corners) + rng.normal(
            scale=NOISE, size=(*moved_corners.shape[:3], 2)
        )
        stamps = np.maximum.accumulate(at + np.abs(rng.normal(0, late, len(at))))
        stamps += 1e-6 * np.arange(len(at))
        views = [TagView(np.arange(TAGS), p, spread((TAGS,), NOISE), p) for p in px]
        watched.append(VideoDetections(stamps, store_views(views), measure_timing(stamps), len(at)))
        true.append(at)
    session_tracks = assemble(watched, Rig(tuple(cameras)), SIDE, ["a", "b"])
    at = true[0]
    lag = float(np.median(session_tracks.tracks.time - at))
    middle = cameras[0].to_camera(move_corners(base, at).mean(axis=2))
    sure = session_tracks.cameras >= 2
    errors_mm = np.linalg.norm(session_tracks.tracks.points - middle, axis=2)
    sigma = np.linalg.norm(session_tracks.tracks.sigma, axis=2)
    both = (at > true[1][0]) & (at < true[1][-1])
    excluded = int((~sure[both].any(axis=1)).sum())
    return (
        excluded,
        1e3 * lag,
        float(2 * np.median(sigma[sure])),
        float(np.percentile(errors_mm[sure], 95)),
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=30.0)
    options = parser.parse_args()
    sys.stdout.write(f"{'':32}{'left out':>10}{'late, ms':>10}{'stated':>9}{'error':>9}\n")
    for title, late, lost, drift in (
        ("in time", 0.0, 0.0, 0.0),
        ("3 ms late", 3e-3, 0.0, 0.0),
        ("10 ms late", 10e-3, 0.0, 0.0),
        ("3 ms late, 15 % lost", 3e-3, 0.15, 0.0),
        ("3 ms late, 15 % lost, 500 ppm", 3e-3, 0.15, 500e-6),
        ("10 ms late, 15 % lost, 500 ppm", 10e-3, 0.15, 500e-6),
    ):
        rows = np.array(
            [trial(late, lost, drift, options.seconds, s) for s in range(options.seeds)]
        )
        worst = rows[np.abs(rows[:, 1]).argmax(), 1]
        sys.stdout.write(
            f"{title:32}{rows[:, 0].sum():10.0f}{worst:10.2f}{np.median(rows[:, 2]):9.3f}"
            f"{rows[:, 3].max():9.3f}\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
