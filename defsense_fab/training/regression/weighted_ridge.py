"""Ridge regression of thousands of pictures with a weight for each marker in each, and its errors
in cross-validation, from sums over folds.

For a marker: sum_t w_t |phi_t beta + b - o_t|^2 + W s^2 tr(beta^T P beta), W = sum_t w_t, P the
mean of J J^T over the pictures, J the slopes of the features phi by the inputs. s is the noise that
the inputs are taken to have: for an affine decoder that is DefSense's Eq. 8 with lambda^2 = W s^2
(`decoding/ridge.py`, on measured pictures). Sums of phi phi^T, phi o and o^2 of each fold are all
that is needed for the coefficients of every s and for their errors on the fold left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from ...core.arrays import Float, Int
from ...decoding.ridge import regular

_BLOCK = 2_000_000  # numbers of products of features at once
#: Standard deviations of the inputs among which cross-validation chooses.
NOISES = np.logspace(-6, 1, 29)


@dataclass(frozen=True)
class Whitened:
    """Features centred and turned so that the penalty is the same for all: phi' = (phi - mean) @
    turn, `turn` (f, f) upper triangular."""

    mean: Float
    turn: Float

    @staticmethod
    def of(phi: Float, slopes: Float, roughness: Float) -> Whitened:
        """For features (t, f) with slopes (t, f, d), and what is added to the penalty (f, f)."""
        flat = np.ascontiguousarray(np.moveaxis(slopes, 2, 1)).reshape(-1, phi.shape[1])
        P = regular(flat.T @ flat / len(phi) + roughness)
        lower = np.linalg.cholesky(P)
        turn = solve_triangular(lower, np.eye(len(P)), lower=True).T
        return Whitened(phi.mean(0), turn)

    def __call__(self, phi: Float) -> Float:
        return np.asarray((phi - self.mean) @ self.turn)

    def plain(self, beta: Float, constant: Float) -> tuple[Float, Float]:
        """Weights (f, o) and constant (o,) of the features as they are."""
        weights = self.turn @ beta
        return weights, constant - self.mean @ weights


@dataclass(frozen=True)
class Sums:
    """Of k folds of pictures and g groups of markers that have one weight in each picture:
    `weight` (k, g), and weighted sums `phi` (k, g, f), `square` (k, g, f, f); of the outputs o
    `out` (k, o), `cross` (k, f, o), `out2` (k, o); `group` (o,) of each output."""

    weight: Float
    phi: Float
    square: Float
    out: Float
    cross: Float
    out2: Float
    group: Int

    def without(self, fold: int | None = None) -> Sums:
        """All folds but one, or all, as one."""
        return self._joined([k for k in range(len(self.weight)) if k != fold])

    def only(self, fold: int) -> Sums:
        """One fold."""
        return self._joined([fold])

    def _joined(self, keep: list[int]) -> Sums:
        return Sums(  # type: ignore[call-arg]
            *(x[keep].sum(0, keepdims=True) for x in
              (self.weight, self.phi, self.square, self.out, self.cross, self.out2)),
            self.group,
        )  # fmt: skip


def sums(phi: Float, outputs: Float, weights: Float, fold: Int) -> Sums:
    """Of features (t, f), outputs (t, m, r) and weights (t, m), zero where an output is not known,
    by `fold` (t,)."""
    f = phi.shape[1]
    m, r = outputs.shape[1:]
    columns, group = _groups(weights)
    o = np.where(weights[..., None] > 0, outputs, 0.0)
    g, k = columns.shape[1], int(fold.max()) + 1
    i, j = np.tril_indices(f)
    weight, linear = np.zeros((k, g)), np.zeros((k, g, f))
    square, cross = np.zeros((k, g, f, f)), np.zeros((k, f, m * r))
    out, out2 = np.zeros((k, m * r)), np.zeros((k, m * r))
    step = max(_BLOCK // len(i), 1)
    for n in range(k):
        mine = np.flatnonzero(fold == n)
        weight[n] = columns[mine].sum(0)
        linear[n] = columns[mine].T @ phi[mine]
        told = (weights[mine, :, None] * o[mine]).reshape(-1, m * r)
        cross[n] = phi[mine].T @ told
        out[n], out2[n] = told.sum(0), (told * o[mine].reshape(-1, m * r)).sum(0)
        half = np.zeros((len(i), g))
        for at in range(0, len(mine), step):
            rows = mine[at : at + step]
            half += (phi[rows][:, i] * phi[rows][:, j]).T @ columns[rows]
        square[n][:, i, j] = square[n][:, j, i] = half.T
    return Sums(weight, linear, square, out, cross, out2, np.repeat(group, r))


def _groups(weights: Float) -> tuple[Float, Int]:
    """Different columns (t, g) of weights (t, m), and which each marker has (m,)."""
    first: dict[bytes, int] = {}
    found, group = list[int](), list[int]()
    for k, column in enumerate(weights.T):
        key = column.tobytes()
        if key not in first:
            first[key] = len(found)
            found.append(k)
        group.append(first[key])
    return np.ascontiguousarray(weights[:, found]), np.array(group)


def solve(total: Sums, noises: Float) -> tuple[Float, Float]:
    """Coefficients (s, f, o) and constants (s, o) for each of the noises (s,), of sums of one fold
    over whitened features."""
    f, o = total.cross.shape[1:]
    beta = np.empty((len(noises), f, o))
    constant = np.empty((len(noises), o))
    for g in range(total.weight.shape[1]):
        mine = total.group == g
        W = max(float(total.weight[0, g]), 1e-300)
        mean, target = total.phi[0, g] / W, total.out[0, mine] / W
        normal = total.square[0, g] / W - np.outer(mean, mean)
        seen = total.cross[0][:, mine] / W - np.outer(mean, target)
        values, vectors = np.linalg.eigh(normal)
        told = vectors.T @ seen
        shrunk = np.maximum(values, 0.0) + np.square(noises)[:, None]
        found = vectors @ (told / shrunk[:, :, None])
        beta[:, :, mine] = found
        constant[:, mine] = target - mean @ found
    return beta, constant


def squared_error(tested: Sums, beta: Float, constant: Float) -> Float:
    """Weighted sums (s, o) of squared errors on one fold of coefficients (s, f, o) and constants
    (s, o)."""
    out = np.empty((len(beta), len(tested.group)))
    for g in range(tested.weight.shape[1]):
        mine = tested.group == g
        B, b, W = beta[:, :, mine], constant[:, mine], tested.weight[0, g]
        out[:, mine] = (
            tested.out2[0, mine]
            - 2 * (B * tested.cross[0][:, mine]).sum(1)
            - 2 * b * tested.out[0, mine]
            + (B * (tested.square[0, g] @ B)).sum(1)
            + 2 * b * (tested.phi[0, g] @ B)
            + W * b**2
        )
    return out


@dataclass(frozen=True)
class RidgePath:
    """Root mean squared error, mm, of each fold (k, s) left out in turn, for each noise (s,)."""

    noises: Float
    errors: Float

    @property
    def best(self) -> int:
        """The noise with the least error; of those within a thousandth of it, the largest."""
        rmse = _over(self.errors)
        return int(np.flatnonzero(rmse <= 1.001 * rmse.min())[-1])

    @property
    def noise(self) -> float:
        return float(self.noises[self.best])

    @property
    def folds(self) -> Float:
        """(k,) at the best noise."""
        return self.errors[:, self.best]

    @property
    def rmse(self) -> float:
        """Over all folds, at the best noise."""
        return float(_over(self.folds))


def _over(folds: Float) -> Float:
    return np.asarray(np.sqrt((folds**2).mean(0)))


def cross_validate(found: Sums, noises: Float = NOISES, axes: int = 3) -> RidgePath:
    """Each fold left out in turn. Errors are of markers with `axes` outputs each."""
    errors = []
    for k in range(len(found.weight)):
        beta, constant = solve(found.without(k), noises)
        tested = found.only(k)
        square = np.maximum(squared_error(tested, beta, constant), 0.0).sum(1)
        weight = tested.weight[0][tested.group].sum() / axes
        errors.append(np.sqrt(square / max(weight, 1e-300)))
    return RidgePath(noises, np.array(errors))
