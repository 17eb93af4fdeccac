"""Random points inside the body, evenly or where its strain varies most between the states."""

from __future__ import annotations

import numpy as np

from ...core.arrays import Float
from ..problem.problem import Problem


def evenly(problem: Problem, count: int, rng: np.random.Generator) -> Float:
    """Points (count, 3) mm spread evenly over the tets' volume."""
    corners = problem.locator.mesh.nodes[problem.locator.mesh.cells[:, :4]]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    tet = rng.choice(len(volume), count, p=volume / volume.sum())
    weights = rng.dirichlet(np.ones(4), count)
    return np.asarray(np.einsum("ci,cij->cj", weights, corners[tet]))


def lively(problem: Problem, points: Float, count: int, rng: np.random.Generator) -> Float:
    """`count` of the points (p, 3), with repeats, the more of them the more the Green strain there
    varies between the states: the paper's advice for where cords should run."""
    varies = np.sqrt(strain(problem, points).var(axis=0).sum((1, 2)))
    if varies.sum() <= 0:
        varies = np.ones(len(points))
    return np.asarray(points[rng.choice(len(points), count, p=varies / varies.sum())])


def strain(problem: Problem, points: Float) -> Float:
    """Green strain (n, p, 3, 3) at points (p, 3) mm in all states, rest first."""
    found = problem.locator.find(points)
    F = np.eye(3) + problem.locator.gradient(found, problem.fields)
    E = (F.swapaxes(-1, -2) @ F - np.eye(3)) / 2
    return np.concatenate([np.zeros((1, *E.shape[1:])), E])
