"""Ridge regression on thousands of frames, with a weight for each marker in each frame.

The loss of a marker is

    sum_t w_t |phi_t beta + b - o_t|^2 + W s^2 tr(beta^T P beta),    W = sum_t w_t,

where P is the penalty of the features (`InputFeatures.penalty`). For polynomials P is the mean of
J J^T over the frames, where J are the slopes of the features phi by the inputs, and s is the
assumed noise of the inputs. For an affine decoder this is DefSense's Eq. 8 with
lambda^2 = W s^2 (`decoding/ridge.py`), on measured frames. Sums of phi phi^T, phi o and o^2 over
each fold suffice for the coefficients at every s, and for their errors on the fold left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from ...core.arrays import Float, Int
from ...decoding.input_decoder import InputFeatures
from ...decoding.ridge import regularize

#: Standard deviations of the inputs among which cross-validation chooses.
INPUT_NOISES = np.logspace(-6, 1, 29)

_NOISE_TOLERANCE = 1.001  # of the smallest error; the largest noise within it is chosen


@dataclass(frozen=True)
class Whitening:
    """A transform of features after which the penalty is the same for all of them.

    The transformed features are (phi - mean) @ transform.

    Attributes:
        mean: Mean of the features, shape (f,).
        transform: Upper triangular matrix, shape (f, f).
    """

    mean: Float
    transform: Float

    @staticmethod
    def fit(features: InputFeatures, inputs: Float) -> tuple[Whitening, Float]:
        """Compute the transform for the features of inputs.

        Args:
            features: The features.
            inputs: Inputs, shape (t, d).

        Returns:
            The transform, and the transformed features, shape (t, f).
        """
        phi = features(inputs)
        P = regularize(features.penalty(inputs))
        lower = np.linalg.cholesky(P)
        transform = solve_triangular(lower, np.eye(len(P)), lower=True).T
        whitening = Whitening(phi.mean(0), transform)
        return whitening, whitening(phi)

    def __call__(self, phi: Float) -> Float:
        """Transform features (t, f)."""
        return np.asarray((phi - self.mean) @ self.transform)

    def undo(self, beta: Float, constant: Float) -> tuple[Float, Float]:
        """Return weights (f, o) and constants (o,) for the original features."""
        weights = self.transform @ beta
        return weights, constant - self.mean @ weights


@dataclass(frozen=True)
class Sums:
    """Weighted sums over k folds of frames, for g groups of markers with equal weights.

    Attributes:
        weight: Sums of the weights, shape (k, g).
        phi: Sums of the features, shape (k, g, f).
        square: Sums of products of features, shape (k, g, f, f).
        out: Sums of the outputs, shape (k, o).
        cross: Sums of products of features and outputs, shape (k, f, o).
        out2: Sums of the squared outputs, shape (k, o).
        group: Group of each output, shape (o,).
        axes: Outputs of a marker.
    """

    weight: Float
    phi: Float
    square: Float
    out: Float
    cross: Float
    out2: Float
    group: Int
    axes: int = 3

    def without(self, fold: int | None = None) -> Sums:
        """Add up all folds except one, or all folds if it is None."""
        return self._add([k for k in range(len(self.weight)) if k != fold])

    def only(self, fold: int) -> Sums:
        """Return the sums of one fold."""
        return self._add([fold])

    def _add(self, folds: list[int]) -> Sums:
        return Sums(
            self.weight[folds].sum(0, keepdims=True),
            self.phi[folds].sum(0, keepdims=True),
            self.square[folds].sum(0, keepdims=True),
            self.out[folds].sum(0, keepdims=True),
            self.cross[folds].sum(0, keepdims=True),
            self.out2[folds].sum(0, keepdims=True),
            self.group,
            self.axes,
        )


def accumulate_sums(phi: Float, outputs: Float, weights: Float, fold: Int) -> Sums:
    """Compute the sums of each fold.

    Args:
        phi: Features, shape (t, f).
        outputs: Outputs of m markers, shape (t, m, r).
        weights: Weights of the markers, shape (t, m); 0 where an output is unknown.
        fold: Fold of each frame, shape (t,).

    Returns:
        The sums, with o = m r outputs.
    """
    f = phi.shape[1]
    m, r = outputs.shape[1:]
    columns, group = _group_weights(weights)
    o = np.where(weights[..., None] > 0, outputs, 0.0)
    g, k = columns.shape[1], int(fold.max()) + 1
    weight, linear = np.zeros((k, g)), np.zeros((k, g, f))
    square, cross = np.zeros((k, g, f, f)), np.zeros((k, f, m * r))
    out, out2 = np.zeros((k, m * r)), np.zeros((k, m * r))
    for n in range(k):
        rows = np.flatnonzero(fold == n)
        weight[n] = columns[rows].sum(0)
        linear[n] = columns[rows].T @ phi[rows]
        weighted = (weights[rows, :, None] * o[rows]).reshape(-1, m * r)
        cross[n] = phi[rows].T @ weighted
        out[n], out2[n] = weighted.sum(0), (weighted * o[rows].reshape(-1, m * r)).sum(0)
        for k_group in range(g):
            square[n, k_group] = (phi[rows] * columns[rows, k_group, None]).T @ phi[rows]
    return Sums(weight, linear, square, out, cross, out2, np.repeat(group, r), r)


def _group_weights(weights: Float) -> tuple[Float, Int]:
    """Return the distinct columns (t, g) of weights (t, m), and each marker's column (m,)."""
    first: dict[bytes, int] = {}
    distinct, group = list[int](), list[int]()
    for k, column in enumerate(weights.T):
        key = column.tobytes()
        if key not in first:
            first[key] = len(distinct)
            distinct.append(k)
        group.append(first[key])
    return np.ascontiguousarray(weights[:, distinct]), np.array(group)


def solve_ridge(total: Sums, noises: Float) -> tuple[Float, Float]:
    """Solve the ridge regression for several noises of the inputs.

    Args:
        total: Sums over whitened features, of one fold.
        noises: Standard deviations of the inputs, shape (s,).

    Returns:
        Coefficients, shape (s, f, o), and constants, shape (s, o).
    """
    f, o = total.cross.shape[1:]
    beta = np.empty((len(noises), f, o))
    constant = np.empty((len(noises), o))
    for g in range(total.weight.shape[1]):
        columns = total.group == g
        W = max(float(total.weight[0, g]), 1e-300)
        mean, target = total.phi[0, g] / W, total.out[0, columns] / W
        normal = total.square[0, g] / W - np.outer(mean, mean)
        covariance = total.cross[0][:, columns] / W - np.outer(mean, target)
        if len(noises) == 1:
            shrunk = normal + noises[0] ** 2 * np.eye(f)
            beta[0][:, columns] = np.linalg.solve(shrunk, covariance)
            constant[0, columns] = target - mean @ beta[0][:, columns]
            continue
        values, vectors = np.linalg.eigh(normal)
        rotated = vectors.T @ covariance
        shrunk = np.maximum(values, 0.0) + np.square(noises)[:, None]
        coefficients = vectors @ (rotated / shrunk[:, :, None])
        beta[:, :, columns] = coefficients
        constant[:, columns] = target - mean @ coefficients
    return beta, constant


def sum_squared_errors(tested: Sums, beta: Float, constant: Float) -> Float:
    """Compute weighted sums of squared errors from sums alone.

    Args:
        tested: Sums of the frames to test on, of one fold.
        beta: Coefficients, shape (s, f, o).
        constant: Constants, shape (s, o).

    Returns:
        The sums, shape (s, o).
    """
    squares = np.empty((len(beta), len(tested.group)))
    for g in range(tested.weight.shape[1]):
        columns = tested.group == g
        B, b, W = beta[:, :, columns], constant[:, columns], tested.weight[0, g]
        squares[:, columns] = (
            tested.out2[0, columns]
            - 2 * (B * tested.cross[0][:, columns]).sum(1)
            - 2 * b * tested.out[0, columns]
            + (B * (tested.square[0, g] @ B)).sum(1)
            + 2 * b * (tested.phi[0, g] @ B)
            + W * b**2
        )
    return squares


@dataclass(frozen=True)
class RidgePath:
    """Cross-validated errors for each noise of the inputs.

    Attributes:
        noises: Standard deviations of the inputs, shape (s,).
        errors: Root mean squared error on each fold left out, shape (k, s), mm.
    """

    noises: Float
    errors: Float

    @property
    def best(self) -> int:
        """Index of the largest noise whose error is within a thousandth of the smallest."""
        rmse = _combine_folds(self.errors)
        return int(np.flatnonzero(rmse <= _NOISE_TOLERANCE * rmse.min())[-1])

    @property
    def noise(self) -> float:
        """The best noise."""
        return float(self.noises[self.best])

    @property
    def folds(self) -> Float:
        """Errors on the folds at the best noise, shape (k,), mm."""
        return self.errors[:, self.best]

    @property
    def rmse(self) -> float:
        """Root mean squared error over all folds at the best noise, mm."""
        return float(_combine_folds(self.folds))


def _combine_folds(errors: Float) -> Float:
    return np.asarray(np.sqrt((errors**2).mean(0)))


def cross_validate(sums: Sums, noises: Float = INPUT_NOISES) -> RidgePath:
    """Compute the errors on each fold of decoders fitted to the other folds.

    Args:
        sums: Sums over whitened features.
        noises: Standard deviations of the inputs to try, shape (s,).

    Returns:
        The errors for each noise.
    """
    errors = []
    for k in range(len(sums.weight)):
        beta, constant = solve_ridge(sums.without(k), noises)
        tested = sums.only(k)
        square = np.maximum(sum_squared_errors(tested, beta, constant), 0.0).sum(1)
        weight = tested.weight[0][tested.group].sum() / sums.axes
        errors.append(np.sqrt(square / max(weight, 1e-300)))
    return RidgePath(noises, np.array(errors))
