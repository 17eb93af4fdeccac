"""Model how far, and how smoothly, a body may differ from its modes.

The difference is a Gaussian field. Its covariance is tau^2 times the Green's function of the
squared Laplacian (a thin plate's), so that what the markers show beyond the modes is spread
smoothly over the surface. The size tau is inferred from each frame's markers: it is integrated out
over a grid, by its marginal likelihood together with the markers' noise (empirical Bayes).

References:
    C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning", MIT Press 2006,
    ch. 2.7 and 5.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...core.machine.compiled import compiled
from .elastic_net import ElasticNet
from .surface_mesh import Attachment

_TAU_GRID = np.geomspace(2e-5, 0.2, 14)  # of the body's size


@dataclass(frozen=True)
class Discrepancy:
    """Covariances of the difference at tau = 1 mm.

    Attributes:
        field: Covariance of the surface with the m markers (n, m).
        markers: Covariance of the markers (m, m).
        grid: Values of tau (g,), mm.
    """

    field: Float
    markers: Float
    grid: Float

    @classmethod
    def of(cls, net: ElasticNet, attachment: Attachment, size: float) -> Discrepancy:
        """Compute the covariances for a body of a `size` (mm)."""
        floating = not net.fixed.any()
        mean = net.area / net.area.sum()
        loads = attachment.matrix(len(net.rest)).toarray().T
        if floating:  # its rigid motion is fitted separately
            loads = loads - mean[:, None]
        once = net.responses(loads)
        if floating:
            once -= mean @ once
        field = net.responses(net.area[:, None] * once)
        if floating:
            field -= mean @ field
        markers = np.einsum("mk,mkp->mp", attachment.weights, field[attachment.corners])
        markers = 0.5 * (markers + markers.T)
        variance = np.diag(markers)
        is_moving = variance > 1e-9 * variance.max()  # others are on fixed vertices
        unit = float(np.median(variance[is_moving])) if is_moving.any() else 1.0
        return cls(field / unit, markers / unit, _TAU_GRID * size)

    def with_noise(self, precision: Float) -> NoisyMarkers:
        """Add markers with noise of standard deviations 1 / precision (m,); 0 is invisible."""
        covariance = precision[:, None] * self.markers * precision
        values, vectors = np.linalg.eigh(covariance)
        return NoisyMarkers(precision, np.maximum(values, 0.0), vectors, self.grid)


@dataclass(frozen=True)
class NoisyMarkers:
    """Markers with noise, in directions in which the difference is uncorrelated.

    Attributes:
        precision: Inverse standard deviations of the noise (m,), 1/mm.
        values: Variances of the difference along the directions, relative to the noise (m,).
        vectors: The directions, as columns (m, m).
        grid: Values of tau (g,), mm.
    """

    precision: Float
    values: Float
    vectors: Float
    grid: Float

    def fit(self, off: Float, slopes: Float, q: Float) -> tuple[Float, Float, float]:
        """Fit the coordinates of the modes together with the difference.

        Args:
            off: Distances of the markers from the surface at q (m, 3), mm.
            slopes: Derivatives of the markers by the coordinates (m, 3, k), mm.
            q: Present coordinates (k,), of unit standard deviation.

        Returns:
            The coordinates (k,), and the shrinkage (m,) and tau (mm) of the difference.
        """
        whiten = self.vectors.T * self.precision
        m, _, k = slopes.shape
        jacobian = (whiten @ slopes.reshape(m, -1)).reshape(m, 3, k)
        observed = whiten @ off + jacobian @ q
        squares = (observed**2).sum(axis=1)
        products = jacobian.transpose(0, 2, 1) @ jacobian
        pulls = np.einsum("mdk,md->mk", jacobian, observed)
        noise = 1.0 / (1.0 + np.outer(self.grid**2, self.values))
        likelihood, coordinates = _marginal(noise, squares, products, pulls)
        p = np.exp(likelihood - likelihood.max())
        p /= p.sum()
        return p @ coordinates, (p * self.grid**2) @ noise, float(np.exp(p @ np.log(self.grid)))

    def loads(self, off: Float, shrinkage: Float) -> Float:
        """Return the factors (m, 3) of the field for distances of the markers (m, 3), mm."""
        inner = shrinkage[:, None] * (self.vectors.T @ (self.precision[:, None] * off))
        return np.asarray(self.precision[:, None] * (self.vectors @ inner))


@compiled(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
def _marginal(noise: Float, squares: Float, products: Float, pulls: Float) -> tuple[Float, Float]:
    """Return log likelihoods (g,) and coordinates (g, k) for each row of weights.

    Args:
        noise: Weights (g, m) of the m directions.
        squares: Squares of the observations (m,).
        products: Products of the slopes (m, k, k).
        pulls: Products of slopes and observations (m, k).
    """
    count, m = noise.shape
    k = pulls.shape[1]
    likelihood, coordinates = np.empty(count), np.empty((count, k))
    system = np.empty((k, k))
    for g in range(count):
        w = noise[g]
        system[:] = 0.0
        q = coordinates[g]
        q[:] = 0.0
        total = 0.0
        for i in range(m):
            total += 1.5 * math.log(w[i]) - 0.5 * w[i] * squares[i]
            for a in range(k):
                q[a] += w[i] * pulls[i, a]
                for b in range(a + 1):
                    system[a, b] += w[i] * products[i, a, b]
        for a in range(k):  # Cholesky factor, in place, of the system with the unit prior
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
    return likelihood, coordinates
