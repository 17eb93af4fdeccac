"""How far, and how smoothly, a body may differ from its modes.

The difference is a Gaussian field: its covariance is tau^2 times the Green's function of the
squared Laplacian (a thin plate's), so that what the markers say beyond the modes is spread
smoothly over the surface. How large tau is, each frame's own markers tell: it is integrated out
over a grid, by its marginal likelihood beside the markers' noise (empirical Bayes; C. E. Rasmussen,
C. K. I. Williams, "Gaussian Processes for Machine Learning", MIT Press 2006, ch. 2.7 and 5.4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.machine.compiled import compiled
from .elastic_net import ElasticNet
from .surface_mesh import Attachment

_GRID = np.geomspace(2e-5, 0.2, 14)  # of the body's size: tau that are thought possible


@dataclass(frozen=True)
class Discrepancy:
    """`field` (n, m): covariance of the surface with the m markers, `markers` (m, m) that among
    them, both at tau = 1 mm; `grid` (g,) mm of tau."""

    field: Float
    markers: Float
    grid: Float

    @classmethod
    def of(cls, net: ElasticNet, attachment: Attachment, size: float) -> Discrepancy:
        """Of a body of this size (mm)."""
        floating = not net.fixed.any()
        mean = net.area / net.area.sum()
        loads = attachment.matrix(len(net.rest)).toarray().T
        if floating:  # its place as a whole is fitted apart
            loads = loads - mean[:, None]
        once = net.responses(loads)
        if floating:
            once -= mean @ once
        field = net.responses(net.area[:, None] * once)
        if floating:
            field -= mean @ field
        markers = np.einsum("mk,mkp->mp", attachment.weights, field[attachment.corners])
        markers = 0.5 * (markers + markers.T)
        own = np.diag(markers)
        moving = own > 1e-9 * own.max()  # others are on what is fixed
        unit = float(np.median(own[moving])) if moving.any() else 1.0
        return cls(field / unit, markers / unit, _GRID * size)

    def beside(self, precision: Float) -> NoisyMarkers:
        """With markers whose noise has standard deviations 1 / precision (m,), 0: not seen."""
        covariance = precision[:, None] * self.markers * precision
        values, vectors = np.linalg.eigh(covariance)
        return NoisyMarkers(precision, np.maximum(values, 0.0), vectors, self.grid)


@dataclass(frozen=True)
class NoisyMarkers:
    """Markers in directions (columns of `vectors`) in which the difference has the variances
    `values` (m,) beside a noise of one."""

    precision: Float
    values: Float
    vectors: Float
    grid: Float

    def fit(self, off: Float, slopes: Float, q: Float) -> tuple[Float, Float, float]:
        """Coordinates of modes (k,) of unit standard deviation, and of the difference that goes
        with them the shrinkage (m,) and tau (mm), of markers that are `off` (m, 3) from the surface
        at q (k,), where they move by `slopes` (m, 3, k)."""
        whiten = self.vectors.T * self.precision
        m, _, k = slopes.shape
        jacobian = (whiten @ slopes.reshape(m, -1)).reshape(m, 3, k)
        seen = whiten @ off + jacobian @ q
        squares = (seen**2).sum(axis=1)
        products = jacobian.transpose(0, 2, 1) @ jacobian
        pulls = np.einsum("mdk,md->mk", jacobian, seen)
        noise = 1.0 / (1.0 + np.outer(self.grid**2, self.values))
        likelihood, found = _marginal(noise, squares, products, pulls)
        p = np.exp(likelihood - likelihood.max())
        p /= p.sum()
        return p @ found, (p * self.grid**2) @ noise, float(np.exp(p @ np.log(self.grid)))

    def loads(self, off: Float, shrinkage: Float) -> Float:
        """(m, 3) that the field of a discrepancy is multiplied by, for markers off by (m, 3) mm."""
        inner = shrinkage[:, None] * (self.vectors.T @ (self.precision[:, None] * off))
        return np.asarray(self.precision[:, None] * (self.vectors @ inner))


@compiled(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def _marginal(noise: Float, squares: Float, products: Float, pulls: Float) -> tuple[Float, Float]:
    """Log likelihood (g,) and coordinates (g, k) for each row of weights `noise` (g, m), of what is
    seen in m directions: `squares` (m,), `products` (m, k, k) of slopes, `pulls` (m, k)."""
    count, m = noise.shape
    k = pulls.shape[1]
    likelihood, found = np.empty(count), np.empty((count, k))
    system = np.empty((k, k))
    for g in range(count):
        w = noise[g]
        system[:] = 0.0
        q = found[g]
        q[:] = 0.0
        total = 0.0
        for i in range(m):
            total += 1.5 * math.log(w[i]) - 0.5 * w[i] * squares[i]
            for a in range(k):
                q[a] += w[i] * pulls[i, a]
                for b in range(a + 1):
                    system[a, b] += w[i] * products[i, a, b]
        for a in range(k):  # Cholesky's factor, in place, of the system and the unit prior
            for b in range(a + 1):
                s = system[a, b] + (1.0 if a == b else 0.0)
                for c in range(b):
                    s -= system[a, c] * system[b, c]
                system[a, b] = math.sqrt(s) if a == b else s / system[b, b]
            s = q[a]
            for c in range(a):
                s -= system[a, c] * q[c]
            q[a] = s / system[a, a]
            total += 0.5 * q[a] * q[a] - math.log(system[a, a])
        for a in range(k - 1, -1, -1):
            s = q[a]
            for c in range(a + 1, k):
                s -= system[c, a] * q[c]
            q[a] = s / system[a, a]
        likelihood[g] = total
    return likelihood, found
