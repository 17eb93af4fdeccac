"""Compare the rigid alignment of 5,000 frames of 12 markers with a loop over SciPy.

    python -m benchmarks.alignment [--frames 5000] [--markers 12] [--repeat 7]

Each frame lacks about a third of the markers; at least four remain. SciPy's
`Rotation.align_vectors` neither centers points nor accepts gaps, so the loop does both, with the
same weights and residuals. The table shows medians of alternating runs in one process after a
warm-up, and the largest difference of the points. `with sigma` also computes covariances, for which
there is no peer.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.spatial.transform import Rotation

from defsense_fab.capture.tracking.alignment import align


def frames(t, m, seed=0):
    """Return moving points (t, m, 3) mm with gaps, the same (m, 3) at rest, and weights (t, m)."""
    rng = np.random.default_rng(seed)
    rest = rng.uniform(-1, 1, (m, 3)) * [75, 15, 15]
    points = rest + rng.normal(0, 0.05, (t, m, 3))
    points = Rotation.random(t, rng=rng).as_matrix() @ points.swapaxes(1, 2)
    points = points.swapaxes(1, 2) + rng.uniform(-300, 300, (t, 1, 3))
    hidden = rng.random((t, m)) < 1 / 3
    hidden[hidden.sum(axis=1) > m - 4] = False
    points[hidden] = np.nan
    return points, rest, rng.uniform(0.5, 2, (t, m))


def loop(points, rest, weights):
    """Return aligned points (t, m, 3) and residuals (t,) mm, computed frame by frame."""
    out, residual = np.full(points.shape, np.nan), np.empty(len(points))
    for k, (frame, w) in enumerate(zip(points, weights, strict=True)):
        visible = np.isfinite(frame[:, 0])
        p, r, w = frame[visible], rest[visible], w[visible] / w[visible].sum()
        at, to = w @ p, w @ r
        rotation, _ = Rotation.align_vectors(r - to, p - at, weights=w)
        out[k, visible] = rotation.apply(p - at) + to
        residual[k] = np.sqrt(((out[k, visible] - r) ** 2).sum(axis=1).mean())
    return out, residual


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=5000)
    parser.add_argument("--markers", type=int, default=12)
    parser.add_argument("--repeat", type=int, default=7)
    options = parser.parse_args()
    points, rest, weights = frames(options.frames, options.markers)
    sigma = np.full(points.shape, 0.05)
    functions = {
        "align": lambda: align(points, rest, weights),
        "align with sigma": lambda: align(points, rest, weights, sigma=sigma),
        "loop over align_vectors": lambda: loop(points, rest, weights),
    }
    times_ms = {name: [] for name in functions}
    align(points, rest, weights), loop(points[:50], rest, weights[:50])
    for _ in range(options.repeat):
        for name, function in functions.items():
            start = time.perf_counter()
            function()
            times_ms[name].append(1e3 * (time.perf_counter() - start))
    result, (peer_points, residual) = functions["align"](), functions["loop over align_vectors"]()
    aligned = result.ok
    print(
        f"{options.frames} frames of {options.markers} markers, {options.repeat} runs, ms:"
        " median (range)"
    )
    for name, ms in times_ms.items():
        print(f"{name:24} {np.median(ms):8.1f} ({min(ms):.1f} to {max(ms):.1f})")
    ratio = np.median(times_ms["loop over align_vectors"]) / np.median(times_ms["align"])
    largest_difference = np.nanmax(np.abs(result.points[aligned] - peer_points[aligned]))
    print(
        f"ratio {ratio:.0f}; largest difference of points {largest_difference:.1e} mm, of residuals"
    )
    print(
        f"{np.abs(result.residual - residual)[aligned].max():.1e} mm;"
        f" {(~aligned).sum()} frames refused"
    )


if __name__ == "__main__":
    main()
