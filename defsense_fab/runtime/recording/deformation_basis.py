"""An animation as few shapes with weights that vary over time.

x(t) = rest + sum_k w_k(t) T_k with the principal components T_k of the displacements (Alexa &
Mueller 2000, Representing animations by principal components): as many as keep every vertex of
every frame within a tolerance. Found in passes over the frames, so that memory does not grow with
their number: a basis is widened by what it leaves of each chunk, then turned to its principal
components.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from .animation import Animation, Float32


@dataclass(frozen=True)
class DeformationBasis:
    """`targets` (k, v, 3) mm and `weights` (n, k), 0 to 1, of the animation's frames. The first
    target is always at 1: it brings rest to where all others only add, as programs cut weights
    below 0 off (Blender's shape keys). The others are the principal components, the largest first.
    `error` (mm) is the largest distance of a vertex from where it was recorded, with both as they
    are."""

    targets: Float32
    weights: Float32
    error: float


def deformation_basis(
    animation: Animation, tolerance: float = 0.02, most: int = 128
) -> DeformationBasis:
    """With one to so many (`most`) components; where these do not reach the `tolerance` (mm),
    `error` says what they reach. Raises LiveError where a position is not finite."""
    wide = _span(animation, tolerance / 2, 2 * most)
    gram = np.zeros((len(wide), len(wide)))
    for _, moved in animation.chunks():
        weights = moved @ wide.T
        gram += weights.T @ weights
    turned = np.linalg.eigh(gram)[1].T[::-1] @ wide
    count = min(_needed(animation, turned, tolerance), most)
    while True:
        basis = _written(animation, turned[:count])
        if basis.error <= tolerance or count >= min(most, len(turned)):
            return basis
        count += 1


def _span(animation: Animation, tolerance: float, most: int) -> Float:
    """Orthonormal directions (k, 3v) whose span holds every vertex within a tolerance (mm)."""
    found = np.zeros((1, animation.rest.size))
    found[0, 0] = 1.0  # of an animation without motion
    used = 0
    for _, moved in animation.chunks():
        left = moved - (moved @ found[:used].T) @ found[:used] if used else moved
        left = left[_largest(left) > tolerance]
        while len(left) and used < most:
            # The directions of the frames that are left, from the small matrix of their products.
            values, vectors = np.linalg.eigh(left @ left.T)
            keep = values[::-1] > 1e-12 * values[-1]
            new = vectors.T[::-1][keep] @ left
            new /= np.linalg.norm(new, axis=1, keepdims=True)
            count = _enough(left, new, tolerance)
            new = _orthonormal(new[: min(count, most - used)], found[:used])
            found = np.concatenate([found[:used], new])
            used = len(found)
            left = left - (left @ new.T) @ new
            left = left[_largest(left) > tolerance]
    return found


def _enough(moved: Float, directions: Float, tolerance: float) -> int:
    """How many of orthonormal directions hold every vertex, found by halving; all where none do."""
    low, high = 0, len(directions)
    while high - low > 1:
        middle = (low + high) // 2
        part = directions[:middle]
        within = _largest(moved - (moved @ part.T) @ part).max() <= tolerance
        low, high = (low, middle) if within else (middle, high)
    return high


def _orthonormal(new: Float, found: Float) -> Float:
    """`new` without what rounding left of its products with itself and with what was `found`."""
    for _ in range(2):
        if len(found):
            new = new - (new @ found.T) @ found
        new = np.linalg.qr(new.T)[0].T
    return new


def _needed(animation: Animation, directions: Float, tolerance: float) -> int:
    """The first so many directions that hold all frames, by the frames one after another."""
    count = 1
    for _, moved in animation.chunks():
        left = moved - (moved @ directions[:count].T) @ directions[:count]
        left = left[_largest(left) > tolerance]
        while len(left) and count < len(directions):
            left = left - np.outer(left @ directions[count], directions[count])
            left = left[_largest(left) > tolerance]
            count += 1
    return count


def _written(animation: Animation, directions: Float) -> DeformationBasis:
    """Rounded to float32, with the error that this leaves."""
    weights = np.concatenate([moved @ directions.T for _, moved in animation.chunks()])
    low = weights.min(axis=0)
    scale = weights.max(axis=0) - low
    shares = (weights - low) / np.where(scale > 0, scale, 1.0)
    rounded = np.column_stack([np.ones(len(shares)), shares]).astype(np.float32)
    targets = np.vstack([low @ directions, directions * scale[:, None]]).astype(np.float32)
    error = 0.0
    for part, moved in animation.chunks():
        shown = rounded[part].astype(float) @ targets.astype(float)
        error = max(error, float(_largest(moved - shown).max()))
    return DeformationBasis(targets.reshape(len(targets), -1, 3), rounded, error)


def _largest(moved: Float) -> Float:
    """The largest distance of a vertex (c,) of displacements (c, 3v)."""
    x = moved.reshape(len(moved), -1, 3)
    return np.asarray(np.sqrt(np.einsum("cvi,cvi->cv", x, x).max(axis=1, initial=0.0)))
