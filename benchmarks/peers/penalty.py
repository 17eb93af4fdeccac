"""A rigid handle with free translation by penalty in NGSolve, in this interpreter.

    python -m benchmarks.peers.penalty problem.npz result.npz

The tets of the handle (`tip`, a mask) get k |F - R|^2 with k far above the material's moduli: they
turn by R and go where they want. The rest is as in `ngsolve_peer.solve`.
"""

from __future__ import annotations

import sys

import ngsolve as ng
import numpy as np

from benchmarks.peers.ngsolve_peer import INVERSE, POINTS, _dofs, _mesh, _scale
from benchmarks.peers.problem import _rotation

STIFF = 1e5  # times the shear modulus
STEPS = 18


def main(problem: str, result: str) -> None:
    with np.load(problem) as f:
        nodes, cells, tip = f["nodes"], f["cells"], f["tip"]
        mu, kappa, fixed, angle = float(f["mu"]), float(f["kappa"]), f["fixed"], f["angle"]
    mesh = _mesh(nodes, cells)
    space = ng.H1(mesh, order=2, dim=3, nodalp2=True)
    dof = _dofs(mesh, space, nodes, cells)
    scale = _scale(mesh, space, nodes, cells, dof)
    held = ng.GridFunction(ng.L2(mesh, order=0))
    held.vec.FV().NumPy()[:] = tip
    entries = [ng.Parameter(float(v)) for v in np.eye(3).ravel()]
    R = ng.CF(tuple(entries), dims=(3, 3))
    F = ng.Id(3) + ng.Grad(space.TrialFunction())
    J = ng.Det(F)
    density = mu / 2 * (J ** (-2 / 3) * ng.InnerProduct(F, F) - 3) + kappa / 2 * (J - 1) ** 2
    density = ng.IfPos(held - 0.5, STIFF * mu * ng.InnerProduct(F - R, F - R), density)
    rule = ng.IntegrationRule(POINTS, [1 / 24] * 4)
    form = ng.BilinearForm(space, symmetric=True)
    form += ng.Variation(density * ng.dx(intrules={ng.ET.TET: rule}))
    free = ng.BitArray(space.ndof)
    free.Set()
    for n in fixed:
        free.Clear(int(dof[n]))
    u = ng.GridFunction(space)
    residual, step = u.vec.CreateVector(), u.vec.CreateVector()
    with ng.TaskManager():
        for k in range(STEPS):
            for parameter, value in zip(
                entries, _rotation((k + 1) / STEPS * angle).ravel(), strict=True
            ):
                parameter.Set(float(value))
            for _ in range(40):
                form.Apply(u.vec, residual)
                form.AssembleLinearization(u.vec)
                step.data = form.mat.Inverse(free, inverse=INVERSE) * residual
                # Where the handle has just been turned, full steps fold the tets beside it.
                length, before = 1.0, form.Energy(u.vec)
                start = u.vec.CreateVector()
                start.data = u.vec
                while length > 1e-3:
                    u.vec.data = start - length * step
                    after = form.Energy(u.vec)
                    if np.isfinite(after) and after <= before * (1 + 1e-12):
                        break
                    length /= 2
                if np.sqrt(abs(ng.InnerProduct(step, residual))) < 1e-9:
                    break
            else:
                raise SystemExit(f"no convergence at step {k + 1} of {STEPS}")
    np.savez(result, u=scale * u.vec.FV().NumPy().reshape(-1, 3)[dof])


if __name__ == "__main__":
    main(*sys.argv[1:])
