"""Solve a coupon whose printed trace is resolved as a second material, by FElupe.

    python -m benchmarks.peers.felupe_trace problem.npz result.npz

The problem contains nodes (n, 3) mm, cells (m, 20) of quadratic hexahedra, is_trace (m,) bool,
moduli (E_body, E_trace) MPa, nu, fixed and moved (node indices), and for each of k loads the
rotation vector (k, 3) rad and the translation (k, 3) mm of the moved nodes about `center`, NaN
where free. The result contains u (k, n, 3) mm, seconds (k,) and iterations (k,).
"""

from __future__ import annotations

import sys
import time
from typing import Any

import felupe
import numpy as np
import scipy.sparse as sp

from benchmarks.peers.felupe_peer import _linear_solver
from benchmarks.peers.problem import _rotation

TOLERANCE = 1e-7  # of the residual, relative to the largest nodal force
MAX_ITERATIONS = 25


def main() -> int:
    with np.load(sys.argv[1]) as f:
        problem = {k: f[k] for k in f.files}
    solved = [
        _solve(problem, rotation, translation)
        for rotation, translation in zip(problem["rotations"], problem["translations"], strict=True)
    ]
    u, seconds, iterations = (np.array(x) for x in zip(*solved, strict=True))
    np.savez(sys.argv[2], u=u, seconds=seconds, iterations=iterations)
    return 0


def _solve(
    problem: dict[str, np.ndarray], rotation: np.ndarray, translation: np.ndarray, steps: int = 3
) -> tuple[np.ndarray, float, int]:
    """Return displacements (n, 3) mm at full load, seconds, and the number of iterations."""
    nodes, cells = problem["nodes"], problem["cells"]
    parts = []
    for of_trace, young in zip((False, True), problem["moduli"], strict=True):
        own = cells[problem["is_trace"] == of_trace]
        if not len(own):
            continue
        region = felupe.RegionQuadraticHexahedron(felupe.Mesh(nodes, own, "hexahedron20"))
        field = felupe.FieldContainer([felupe.Field(region, dim=3)])
        nu = float(problem["nu"])
        law = felupe.NeoHooke(mu=young / (2 * (1 + nu)), bulk=young / (3 * (1 - 2 * nu)))
        parts.append((field, felupe.SolidBody(law, field)))
    moved, count = problem["moved"], len(nodes)
    held = np.zeros((count, 3), bool)
    held[problem["fixed"]] = held[moved] = True
    free = np.flatnonzero(~held.ravel())
    axes = np.flatnonzero(np.isnan(translation))
    rows = [free] + [3 * moved + a for a in axes]
    columns = [np.arange(len(free))] + [
        np.full(len(moved), len(free) + i) for i in range(len(axes))
    ]
    row, column = np.concatenate(rows), np.concatenate(columns)
    transfer = sp.csr_matrix(
        (np.ones(len(row)), (row, column)), shape=(3 * count, len(free) + len(axes))
    )
    linear = _linear_solver()
    arm = nodes[moved] - problem["center"]
    u, iterations, start = np.zeros((count, 3)), 0, time.perf_counter()
    before = np.zeros((len(moved), 3))
    for step in range(1, steps + 1):
        share = step / steps
        target = arm @ _rotation(share * rotation).T - arm + share * np.nan_to_num(translation)
        change = np.zeros((count, 3))
        change[moved] = target - before
        before = target
        for _ in range(MAX_ITERATIONS):
            force, matrix = _assemble(parts, u)
            right = -(transfer.T @ (force + matrix @ change.ravel()))
            if not change.any() and np.abs(right).max() < TOLERANCE * np.abs(force).max():
                break
            by = linear(transfer.T @ matrix @ transfer, right)
            u = u + change + (transfer @ by).reshape(-1, 3)
            change = np.zeros_like(change)
            iterations += 1
        else:
            raise RuntimeError("FElupe did not converge")
    return u, time.perf_counter() - start, iterations


def _assemble(parts: list[tuple[Any, Any]], u: np.ndarray) -> tuple[np.ndarray, Any]:
    force, matrix = 0.0, 0.0
    for field, body in parts:
        field[0].values[:] = u
        force = force + body.assemble.vector(field).toarray().ravel()
        matrix = matrix + body.assemble.matrix(field)
    return force, matrix.tocsr()


if __name__ == "__main__":
    raise SystemExit(main())
