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
            add_poses(a, b.knots, b.counts, b.values, b.slopes, total, jacobian)
            return total, jacobian

        found = least_squares(
            lambda a: np.concatenate([((both(a)[0] - u) / SD).ravel(), a]),
            np.clip(self._last, 1e-6, 1.5 - 1e-6),
            lambda a: np.vstack([both(a)[1].reshape(len(a), -1).T / SD, np.eye(len(a))]),
            bounds=(0, 1.5),
        )
        self._last = found.x
        return np.asarray(found.x)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--markers", type=int, default=40)
    parser.add_argument("--samples", type=int, default=1500)
    asked = parser.parse_args()
    rng = np.random.default_rng(0)
    basis = poses(markers(asked.markers, rng))
    own, peer = PoseAmplitudes(basis), Peer(basis)
    sd = np.full(asked.markers, SD)
    spent: dict[str, list[float]] = {"own": [], "peer": []}
    off: dict[str, list[Float]] = {"own": [], "peer": []}
    for n in range(asked.samples):
        t = n / 60
        bend, twist = np.sin(2 * t), 0.7 * np.sin(3.1 * t)
        left, pull = 0.4 * max(0, np.sin(1.3 * t)), 0.5 * max(0, np.sin(0.7 * t))
        true = np.array([max(bend, 0), max(-bend, 0), max(twist, 0), max(-twist, 0), left, pull])
        u = basis.displacements(true) + rng.normal(0, SD, (asked.markers, 3))
        for name, work in (("own", lambda u=u: own(u, sd).values), ("peer", lambda u=u: peer(u))):
            begun = time.thread_time()
            found = work()  # type: ignore[no-untyped-call]
            spent[name].append(1e3 * (time.thread_time() - begun))
            off[name].append(found - true)
    for name, title in (("own", "defsense_fab"), ("peer", "scipy trf")):
        p50, p99 = np.percentile(spent[name], [50, 99])
        error = np.sqrt(np.mean(np.square(off[name])))
        print(f"{title:13s} median {p50:7.3f} ms   99 % {p99:7.3f} ms   off {error:.4f}")


if __name__ == "__main__":
    main()
