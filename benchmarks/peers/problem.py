"""Read problems for peers from files, and prescribe their load fractions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np


def fractions(increments: int | Sequence[float]) -> list[float]:
    """Return load fractions in (0, 1]: equal increments, or the given ones."""
    if isinstance(increments, (int, np.integer)):
        return [(i + 1) / increments for i in range(increments)]
    return [float(t) for t in increments]


def load(path: Path) -> dict[str, Any]:
    """Return the first seven arguments of `solve` of a peer, from an npz file.

    The file contains nodes (n, 3) mm, cells (m, 10), mu and kappa (MPa), fixed and moved (node
    indices), and the rigid movement of the moved nodes: `angle` (3,) rad, their rotation vector at
    full load, `centre` (3,) mm of the rotation, and `centre_path` (k + 1, 3) mm, the displacements
    of this center at the load fractions linspace(0, 1, k + 1).
    """
    with np.load(path) as f:
        moved = f["moved"]
        return {
            "nodes": f["nodes"],
            "cells": f["cells"],
            "mu": float(f["mu"]),
            "kappa": float(f["kappa"]),
            "fixed": f["fixed"],
            "moved": moved,
            "positions": rigid_path(f["nodes"][moved], f["angle"], f["centre"], f["centre_path"]),
        }


def rigid_path(
    nodes: np.ndarray, angle: np.ndarray, centre: np.ndarray, centre_path: np.ndarray
) -> Callable[[float], np.ndarray]:
    """Return displacements (k, 3) mm of `nodes` (k, 3), rotated and moved, by load fraction."""
    arm = nodes - centre
    table = np.linspace(0, 1, len(centre_path))

    def positions(t: float) -> np.ndarray:
        shift = [np.interp(t, table, column) for column in centre_path.T]
        return arm @ _rotation(t * angle).T - arm + shift

    return positions


def _rotation(vector: np.ndarray) -> np.ndarray:
    """Return the matrix (3, 3) of a rotation vector (3,) rad, by Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k)
