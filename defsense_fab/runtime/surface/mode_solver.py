"""The surface from the modes of simulated states, and beyond them as far as the markers ask.

A frame takes three steps: the modes' coordinates, and how far the body may differ from them, from
the markers with their noise; the surface of the modes, on which what the markers say beyond is
spread smoothly; then each vertex' rotation is fitted anew to that surface as rigidly as possible,
with its edges as strained as the modes say, and the surface integrated again. The last step is
repeated where the body is far from all modes.
"""

from __future__ import annotations

from collections import OrderedDict

import numpy as np

from ...core.arrays import Float
from .attachment import Attachment
from .discrepancy import Discrepancy, NoisyMarkers
from .elastic_net import ElasticNet
from .local_step import fit_rotations
from .marker_map import MarkerMap
from .rigid_fit import rigid_fit
from .rotation_strain import RotationStrain
from .time_budget import TimeBudget

_FITS = 4  # steps of Gauss and Newton for the coordinates
_SETTLED = 1e-3  # standard deviations of a coordinate
_FURTHEST = 1.2  # of the range of the polynomials, which say nothing beyond
_FAR = 0.01  # of the body's size: further from the modes, rotations are fitted more than once
_MOST = 4  # fits of rotations: more take up the markers' noise
_CERTAIN = 1e-4  # of the body's size: no marker is better known than that
_KEPT = 4  # sets of uncertainties whose decomposition is kept


class ModeSolver:
    """Of simulated states as vertices (s, n, 3) mm in the net's order. `beyond`: whether the
    surface may leave the modes."""

    def __init__(
        self, net: ElasticNet, states: Float, attachment: Attachment, size: float,
        beyond: bool = True,
    ) -> None:  # fmt: skip
        self._net, self._attachment, self._size, self._beyond = net, attachment, size, beyond
        self._modes = RotationStrain.of(net, states)
        self._map = MarkerMap.of(self._modes, attachment)
        self._discrepancy = Discrepancy.of(net, attachment, size)
        self._noises: OrderedDict[bytes, NoisyMarkers] = OrderedDict()
        self._floating = not net.fixed.any()
        self.rounds = 0
        self.tau = 0.0
        self.reset()

    def reset(self) -> None:
        """Begin at rest."""
        self._q = np.zeros(self._modes.modes)
        self._turn, self._shift = np.eye(3), np.zeros(3)
        self._bias = np.zeros(self._attachment.offset.shape)

    @property
    def name(self) -> str:
        """In words."""
        beyond = ", and beyond them as rigid as possible" if self._beyond else ""
        return f"{self._modes.modes} modes of the simulated states{beyond}"

    def solve(self, markers: Float, sd: Float, budget: TimeBudget) -> tuple[Float, Float]:
        """Vertices (n, 3) mm and their rotations (n, 9) of markers (m, 3) mm with standard
        deviations (m,) mm; the place of those that are not seen (infinite) is of no matter."""
        net = self._net
        noise = self._noise(sd)
        markers = np.where(noise.precision[:, None] > 0, markers, 0.0)
        while budget.allows():
            shrinkage = self._fit(markers, noise)
            x, rotations, edges = self._modes.surface(self._q, net.rest)
            if self._settled(x, rotations):
                break
        turn, shift = self._turn, self._shift
        own = (markers - shift) @ turn  # in the frame of the body at rest
        self.rounds = 0
        if self._beyond:
            x = self._corrected(x, rotations, own, noise, shrinkage)
            far = self.tau > _FAR * self._size
            while self.rounds < (_MOST if far else 1) and budget.allows():
                right = np.zeros((3, len(x)))
                fit_rotations(net.ptr, net.ends, net.weights, edges, x, rotations, right)
                x = net.integrate(right, net.rest)
                x = self._corrected(x, rotations, own, noise, shrinkage)
                self.rounds += 1
        if self._floating:
            x = x @ turn.T + shift
            rotations = np.einsum("ij,njk->nik", turn, rotations.reshape(-1, 3, 3)).reshape(-1, 9)
        return x, rotations

    def _fit(self, markers: Float, noise: NoisyMarkers) -> Float:
        """Find the coordinates, and where the body is as a whole if nothing is fixed; returns the
        shrinkage (m,) of its difference from the modes."""
        for _ in range(_FITS):
            at, slopes = self._map.at(self._q)
            at = at + self._bias
            if self._floating and np.count_nonzero(noise.precision) > 2:
                self._turn, self._shift = rigid_fit(at, markers, noise.precision**2)
            off = (markers - self._shift) @ self._turn - at
            q, shrinkage, self.tau = noise.fit(off, slopes, self._q)
            q = np.clip(q, -_FURTHEST * self._map.limits, _FURTHEST * self._map.limits)
            moved = float(np.abs(q - self._q).max())
            self._q = q
            if moved < _SETTLED:
                break
        return shrinkage

    def _settled(self, x: Float, rotations: Float) -> bool:
        """Whether markers on the surface of the modes are where the fit took them to be. What its
        polynomials are off by is put right in the next fit, which may be that of the next frame."""
        attachment = self._attachment
        at = attachment.on_surface(x) + attachment.stand_off(rotations)
        bias = at - self._map.at(self._q)[0]
        change = float(np.abs(bias - self._bias).max())
        self._bias = bias
        return change < _CERTAIN * self._size

    def _corrected(
        self, x: Float, rotations: Float, markers: Float, noise: NoisyMarkers, shrinkage: Float
    ) -> Float:
        attachment = self._attachment
        off = markers - attachment.stand_off(rotations) - attachment.on_surface(x)
        return np.asarray(x + self._discrepancy.field @ noise.loads(off, shrinkage))

    def _noise(self, sd: Float) -> NoisyMarkers:
        key = sd.tobytes()
        found = self._noises.pop(key, None)
        if found is None:
            found = self._discrepancy.beside(1.0 / np.maximum(sd, _CERTAIN * self._size))
        self._noises[key] = found
        if len(self._noises) > _KEPT:
            self._noises.popitem(last=False)
        return found
