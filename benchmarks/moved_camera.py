"""Tracks from cameras one of which is moved while it records, against the truth.

    python -m benchmarks.moved_camera                    # 10 seeds of each condition
    python -m benchmarks.moved_camera --seeds 3 --seconds 20

Two or three cameras of 30 frames/s that run freely see twelve tags on a body that is moved by hand.
At a random time one of them, at random, turns about a point 60 mm behind its lens, within 0.1 s.
Corners have noise of 0.03 px, and what a camera model lacks: a radial error of `--lens` (1 % of the
cube of the distance from the middle), and tags that look larger and smaller by `--bias` px as the
light changes. `found` are trials in which one move is told, within 0.5 s and 20 % of the angle
(a right `none` where nothing is turned), `named` those in which the camera is, too; `error` is the
95th percentile of the distance from the true place, mm, in all frames and, `after`, in those after
the move, once laid onto the true tags frame by frame, as sessions lay them onto the anchor.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace

import numpy as np

from benchmarks.late_stamps import NOISE, SIDE, TAGS, moved
from defsense_fab.capture.cameras.image_sources import timing
from defsense_fab.capture.cameras.rig_file import Rig
from defsense_fab.capture.tags.detection import TagView
from defsense_fab.capture.tracking.alignment import align
from defsense_fab.capture.tracking.observations import stored
from defsense_fab.capture.videos.video_detection import VideoDetections
from defsense_fab.capture.videos.video_tracks import assemble
from defsense_fab.core.arrays import Float
from defsense_fab.core.camera import Camera, rotation_matrices
from tests.capture.rigs import flat, rig, spread, tags

_PIVOT, _TAKES, _HALVES = np.array([0.0, 0.0, -60.0]), 0.1, 0.05


def turned(camera: Camera, axis: Float) -> Camera:
    """Turned by a vector (3,) rad about the pivot behind its lens."""
    R = rotation_matrices(axis)
    return replace(
        camera,
        rotation=R @ camera.rotation,
        translation=R @ (camera.translation - _PIVOT) + _PIVOT,
    )


def trial(
    count: int, degrees: float, lens: float, bias: float, seconds: float, seed: int
) -> tuple[bool, bool, float, float]:
    """Whether what happened is told, and of which camera; errors, mm, in all frames and after."""
    rng = np.random.default_rng(seed)
    cameras, base = rig(count), tags(TAGS, rng)
    when, who = rng.uniform(0.15, 0.85) * seconds, int(rng.integers(count))
    axis = rng.normal(size=3)
    axis *= np.radians(degrees) / np.linalg.norm(axis)
    watched = []
    times = []
    for k, camera in enumerate(cameras):
        at = rng.uniform(0, 1 / 30) + np.arange(round(30 * seconds)) / 30
        shown = moved(base, at)
        px = flat(camera, shown)
        if k == who and degrees:
            part = np.clip((at - when) / _TAKES, 0, 1)
            for j in np.flatnonzero(part > 0):
                px[j] = flat(turned(camera, part[j] * axis), shown[j])
        off = (px - camera.matrix[:2, 2]) / camera.focal
        px = px + lens * camera.focal * off * (off**2).sum(-1, keepdims=True)
        out = px - px.mean(axis=2, keepdims=True)
        out /= np.linalg.norm(out, axis=-1, keepdims=True)
        px = px + bias * np.sin(0.5 * at + k)[:, None, None, None] * out
        px = px + rng.normal(scale=NOISE, size=px.shape)
        views = [TagView(np.arange(TAGS), p, spread((TAGS,), NOISE), p) for p in px]
        watched.append(VideoDetections(at, stored(views), timing(at), len(at)))
        times.append(at)
    found = assemble(watched, Rig(tuple(cameras)), SIDE, list("abc"[:count]))
    told = found.quality.get("moved", [])
    near = [
        m for m in told
        if abs(m["time"] - when) < 0.5 and abs(m["degrees"] / max(degrees, 1e-9) - 1) < 0.2
    ]  # fmt: skip
    right = not told if not degrees else len(told) == 1 and len(near) == 1
    named = right and (not degrees or (near[0]["sure"] and near[0]["camera"] == who))
    t = found.tracks
    true = moved(base, times[0]).mean(axis=2)
    points = np.where((found.cameras >= 2)[..., None], t.points, np.nan)
    rest = base.mean(axis=1)
    weights = np.ones(points.shape[:2])
    laid, truth = align(points, rest, weights), align(true, rest, weights)
    off = np.linalg.norm(laid.points - truth.points, axis=2)
    after = off[times[0] > when + 0.5]
    return right, named, *(float(np.nanpercentile(o, 95)) for o in (off, after))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--lens", type=float, default=0.01)
    parser.add_argument("--bias", type=float, default=0.05, help="px")
    options = parser.parse_args()
    sys.stdout.write(f"{'':24}{'found':>8}{'named':>8}{'error':>9}{'after':>9}\n")
    for count in (2, 3):
        for degrees in (0.0, 0.1, 0.2, 0.5):
            rows = [
                trial(count, degrees, options.lens, options.bias, options.seconds, s)
                for s in range(options.seeds)
            ]
            right, named, error, after = np.array(rows).T
            sys.stdout.write(
                f"{count} cameras, {degrees:.1f} degrees   {right.sum():8.0f}{named.sum():8.0f}"
                f"{error.max():9.3f}{after.max():9.3f}\n"
            )
            sys.stdout.flush()


if __name__ == "__main__":
    main()
