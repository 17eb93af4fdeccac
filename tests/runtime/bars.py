"""A bar of 150 mm with markers that is bent, twisted and pulled by closed formulas."""

import numpy as np

from defsense_fab.runtime.controls.pose_amplitudes import PoseBasis, PoseRamp

LENGTH = 150.0
STEPS = np.array([0.25, 0.5, 0.75, 1.0])
POSES = ("bend_up", "bend_down", "twist_left", "twist_right", "bend_left", "pull")


def markers(count, rng):
    """Return random marker positions at rest (m, 3), mm."""
    return rng.uniform([0, -15, -15], [LENGTH, 15, 15], (count, 3))


def bent(rest, amplitude, sign=1, axis=2):
    """Return displacements (m, 3) of a bend onto a circle, by 90 degrees at amplitude 1."""
    k = amplitude * np.pi / 2 / LENGTH
    if k == 0:
        return np.zeros_like(rest)
    height, angle, moved = sign * rest[:, axis], k * rest[:, 0], rest.copy()
    moved[:, 0] = (1 / k - height) * np.sin(angle)
    moved[:, axis] = sign * (1 / k - (1 / k - height) * np.cos(angle))
    return moved - rest


def twisted(rest, amplitude, sign=1):
    angle, moved = sign * amplitude * np.pi / 2 * rest[:, 0] / LENGTH, rest.copy()
    moved[:, 1] = rest[:, 1] * np.cos(angle) - rest[:, 2] * np.sin(angle)
    moved[:, 2] = rest[:, 1] * np.sin(angle) + rest[:, 2] * np.cos(angle)
    return moved - rest


def pulled(rest, amplitude):
    return amplitude * rest * [0.2, -0.1, -0.1]


def poses(rest):
    """Return the basis of the six POSES."""

    def ramp(shape, *args):
        return PoseRamp(STEPS, np.array([shape(rest, a, *args) for a in STEPS]))

    return PoseBasis(
        POSES,
        (ramp(bent), ramp(bent, -1), ramp(twisted), ramp(twisted, -1), ramp(bent, 1, 1),
         ramp(pulled)),
    )  # fmt: skip
