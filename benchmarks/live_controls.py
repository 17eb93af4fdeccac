"""Compare pose amplitudes from markers with SciPy's bounded least squares.

    python -m benchmarks.live_controls                 # 6 poses, 40 markers
    python -m benchmarks.live_controls --markers 200

A bar is bent, twisted and pulled in mixtures, with noise of 0.5 mm. Both solvers start at the
amplitudes of the last sample and minimize the same sum; SciPy gets the derivatives, too. The table
shows CPU time per sample (median and 99th percentile, ms) and the RMS error of the amplitudes.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.optimize import least_squares

from defsense_fab.core.arrays import Float
from defsense_fab.runtime.controls.least_squares import add_poses
from defsense_fab.runtime.controls.pose_amplitudes import PoseAmplitudes, PoseBasis
from tests.runtime.bars import markers, poses

SD = 0.5


class Peer:
    """Amplitudes by scipy.optimize.least_squares with bounds (trf)."""

    def __init__(self, basis: PoseBasis) -> None:
        self._basis, self._last = basis, np.zeros(len(basis.names))

    def __call__(self, u: Float) -> Float:
        b = self._basis

        def both(a: Float) -> tuple[Float, Float]:
            total = np.zeros(u.shape)
            jacobian = np.empty((len(a), *u.shape))
            add_poses(a, b.packed, total, jacobian)
            return total, jacobian

        amplitudes = least_squares(
            lambda a: np.concatenate([((both(a)[0] - u) / SD).ravel(), a]),
            np.clip(self._last, 1e-6, 1.5 - 1e-6),
            lambda a: np.vstack([both(a)[1].reshape(len(a), -1).T / SD, np.eye(len(a))]),
            bounds=(0, 1.5),
        )
        self._last = amplitudes.x
        return np.asarray(amplitudes.x)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--markers", type=int, default=40)
    parser.add_argument("--samples", type=int, default=1500)
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    basis = poses(markers(options.markers, rng))
    ours, peer = PoseAmplitudes(basis), Peer(basis)
    sd = np.full(options.markers, SD)
    times_ms: dict[str, list[float]] = {"own": [], "peer": []}
    errors: dict[str, list[Float]] = {"own": [], "peer": []}
    for n in range(options.samples):
        t = n / 60
        bend, twist = np.sin(2 * t), 0.7 * np.sin(3.1 * t)
        left, pull = 0.4 * max(0, np.sin(1.3 * t)), 0.5 * max(0, np.sin(0.7 * t))
        true = np.array([max(bend, 0), max(-bend, 0), max(twist, 0), max(-twist, 0), left, pull])
        u = basis.displacements(true) + rng.normal(0, SD, (options.markers, 3))
        for name, work in (("own", lambda u=u: ours(u, sd).values), ("peer", lambda u=u: peer(u))):
            started_at = time.thread_time()
            amplitudes = work()  # type: ignore[no-untyped-call]
            times_ms[name].append(1e3 * (time.thread_time() - started_at))
            errors[name].append(amplitudes - true)
    for name, title in (("own", "defsense_fab"), ("peer", "scipy trf")):
        p50, p99 = np.percentile(times_ms[name], [50, 99])
        error = np.sqrt(np.mean(np.square(errors[name])))
        print(f"{title:13s} median {p50:7.3f} ms   99 % {p99:7.3f} ms   off {error:.4f}")


if __name__ == "__main__":
    main()
