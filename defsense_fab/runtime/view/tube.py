"""A cord as a tube around its path."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float, Int

_SIDES = 8


def tube_faces(count: int) -> Int:
    """(f, 3) of a tube along a path of `count` points, open at its ends."""
    ring = np.arange(_SIDES)
    along = _SIDES * np.arange(count - 1)[:, None]
    a, b = along + ring, along + (ring + 1) % _SIDES
    quads = np.stack([a, b, b + _SIDES, a, b + _SIDES, a + _SIDES], axis=-1)
    return np.asarray(quads.reshape(-1, 3), np.int64)


def tube_vertices(path: Float, radius: float) -> Float:
    """(8 p, 3) mm around a path (p, 3) mm."""
    along = np.gradient(path, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    # One direction that no part of the path runs along keeps neighbouring rings in step.
    spread = np.linalg.eigh(along.T @ along)[1][:, 0]
    x = np.cross(along, np.where(np.abs(along @ spread)[:, None] < 0.99, spread, spread[::-1]))
    x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)
    y = np.cross(along, x)
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    ring = np.cos(angle)[:, None] * x[:, None] + np.sin(angle)[:, None] * y[:, None]
    return np.asarray((path[:, None] + radius * ring).reshape(-1, 3))
