"""Solve poses by NGSolve: a symbolic energy, compiled to C++ if possible, and its Newton solver.

The line search of the solver is not used: it accepts NaN energies. With these refused it did not
need fewer increments.
"""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import netgen.meshing
import ngsolve as ng
import numpy as np
from ngsolve.nonlinearsolvers import NewtonSolver

from benchmarks.peers.problem import fractions

TOLERANCE = 1e-7  # of the step in the energy norm, relative to (mu volume)^(1/2)
THREADS = 2
INVERSE = "sparsecholesky"  # of those in the wheel the fastest on these matrices
_A, _B = 0.585410196624968454, 0.138196601125010515
POINTS = [(_A, _B, _B), (_B, _A, _B), (_B, _B, _A), (_B, _B, _B)]


def solve(
    nodes: np.ndarray,
    cells: np.ndarray,
    mu: float,
    kappa: float,
    fixed: np.ndarray,
    moved: np.ndarray,
    positions: Callable[[float], np.ndarray],
    increments: int | Sequence[float],
    folder: Path | None = None,
) -> tuple[np.ndarray, dict[str, Any]]:
    """Return displacements (n, 3) mm at full load, and statistics.

    Args:
        nodes: Nodes (n, 3) mm.
        cells: Quadratic tetrahedra (m, 10) in VTK's order.
        mu: Shear modulus, MPa.
        kappa: Bulk modulus, MPa.
        fixed: Indices of the fixed nodes.
        moved: Indices (k,) of the moved nodes.
        positions: Function of the load fraction t: displacements (k, 3) mm of the moved nodes.
        folder: Unused.

    Raises:
        RuntimeError: The solver does not converge.
    """
    steps = fractions(increments)
    ng.SetNumThreads(THREADS)
    mesh = _mesh(nodes, cells)
    # The hierarchical basis would couple a prescribed edge midpoint to a free corner. The Lagrange
    # basis is an undocumented flag, of which NGSolve warns on stderr.
    space = ng.H1(mesh, order=2, dim=3, nodalp2=True)
    dof = _dofs(mesh, space, nodes, cells)
    scale = _scale(mesh, space, nodes, cells, dof)
    density, compiled = _density(space.TrialFunction(), mu, kappa)
    rule = ng.IntegrationRule(POINTS, [1 / 24] * 4)
    form = ng.BilinearForm(space, symmetric=True)
    form += ng.Variation(density * ng.dx(intrules={ng.ET.TET: rule}))
    free = ng.BitArray(space.ndof)
    free.Set()
    for n in np.concatenate([fixed, moved]):
        free.Clear(int(dof[n]))
    u, target = ng.GridFunction(space), ng.GridFunction(space)
    to = target.vec.FV().NumPy().reshape(-1, 3)
    newton = NewtonSolver(form, u, freedofs=free, inverse=INVERSE)
    with ng.TaskManager():
        volume = ng.Integrate(ng.CF(1), mesh)
        start = time.perf_counter()
        iterations = 0
        for t in steps:
            target.vec.data = u.vec
            to[dof[moved]] = positions(t) / scale
            iterations += _increment(newton, target.vec, TOLERANCE * (mu * volume) ** 0.5, t)
        seconds = time.perf_counter() - start
        if not np.isfinite(form.Energy(u.vec)):
            raise RuntimeError("NGSolve: an element is inside out")
    stats = {
        "seconds": seconds,
        "iterations": iterations,
        "increments": len(steps),
        "version": f"ngsolve {ng.__version__}, {INVERSE}, {'C++' if compiled else 'interpreted'}",
    }
    return scale * u.vec.FV().NumPy().reshape(-1, 3)[dof], stats


def _increment(newton: NewtonSolver, target: Any, tolerance: float, t: float) -> int:
    """Return the linear solves of an increment: NGSolve's linear predictor, then Newton."""

    def watch(iteration: int, error: float) -> None:
        if not np.isfinite(error):  # NGSolve would iterate on to the limit
            raise RuntimeError(f"NGSolve at load fraction {t:g}: NaN in iteration {iteration + 1}")

    newton.SetDirichlet(target)
    with contextlib.redirect_stdout(io.StringIO()):  # prints when it does not converge
        failed, count = newton.Solve(maxit=40, maxerr=tolerance, callback=watch)
    if failed:
        raise RuntimeError(f"NGSolve at load fraction {t:g}: no convergence in {count} iterations")
    return int(count) + 1


def _density(u: Any, mu: float, kappa: float) -> tuple[Any, bool]:
    """Return the energy density of the trial function, and whether it is compiled to C++."""
    F = ng.Id(3) + ng.Grad(u)
    J = ng.Det(F)
    isochoric = mu / 2 * (J ** (-2 / 3) * ng.InnerProduct(F, F) - 3)
    density = isochoric + kappa / 2 * (J - 1) ** 2  # NaN where an element is inside out
    beside = os.path.dirname(sys.executable)  # where the wheel puts its compiler wrapper
    if beside not in os.environ["PATH"].split(os.pathsep):
        os.environ["PATH"] = beside + os.pathsep + os.environ["PATH"]
    compiled = bool(shutil.which("ngscxx") and (shutil.which("g++") or shutil.which("c++")))
    return density.Compile(realcompile=compiled, wait=True, maxderiv=2), compiled


def _mesh(nodes: np.ndarray, cells: np.ndarray) -> ng.Mesh:
    """Return the straight tets; the corners are the first nodes and keep their numbers."""
    corners = np.ascontiguousarray(cells[:, :4], np.int32)
    mesh = netgen.meshing.Mesh(dim=3)
    mesh.AddPoints(np.ascontiguousarray(nodes[: corners.max() + 1]))
    mesh.AddElements(dim=3, index=1, data=corners, base=0)
    return ng.Mesh(mesh)


def _dofs(mesh: ng.Mesh, space: Any, nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Return the number (n,) of the basis function of each node."""
    pairs = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
    ends = np.sort(cells[:, pairs].reshape(-1, 2), axis=1).tolist()
    middle = dict(zip(map(tuple, ends), cells[:, 4:].ravel().tolist(), strict=True))
    dof = np.full(len(nodes), -1)
    dof[: mesh.nv] = np.arange(mesh.nv)
    for edge in mesh.edges:
        a, b = sorted(v.nr for v in edge.vertices)
        (dof[middle[a, b]],) = space.GetDofNrs(edge)
    if set(dof.tolist()) != set(range(space.ndof)):
        raise ValueError("the corners must be the first nodes, and each node be in a cell")
    return dof


def _scale(
    mesh: ng.Mesh, space: Any, nodes: np.ndarray, cells: np.ndarray, dof: np.ndarray
) -> float:
    """Return the value of each basis function at its node (NGSolve 6.2 scales them to 1/4).

    Raises:
        RuntimeError: The basis is not a multiple of Lagrange's. The check is for all at once: the
            coefficients are values of a quadratic function, which the basis must reproduce.
    """

    def quadratic(x: np.ndarray) -> np.ndarray:
        scaled = x / np.abs(nodes).max()
        return np.stack([1 + (scaled**2).sum(-1), scaled[..., 0], scaled[..., 1:].prod(-1)], -1)

    function = ng.GridFunction(space)
    function.vec.FV().NumPy().reshape(-1, 3)[dof] = quadratic(nodes)
    some = nodes[cells[:: len(cells) // 8 + 1, :4]]
    points = np.einsum("mci,c->mi", some, [0.4, 0.3, 0.2, 0.1])
    got = np.array([function(mesh(*x)) for x in points])
    expected = quadratic(points)
    scale = float((got * expected).sum() / (expected**2).sum())
    if np.abs(got - scale * expected).max() > 1e-9:
        raise RuntimeError("this NGSolve's nodalp2 is not a Lagrange basis")
    return scale
