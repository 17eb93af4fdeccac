"""Check solved poses in plain NumPy, without any code of the solver.

Shape functions come from the Vandermonde matrix of the element's nodes. Energies are functions of
the principal stretches, and stresses are their derivatives. The quadrature has the four points of
the solver, because the energies must be equal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_R = (5 - np.sqrt(5)) / 20
FOUR = np.array([[_R] * 3, [1 - 3 * _R, _R, _R], [_R, 1 - 3 * _R, _R], [_R, _R, 1 - 3 * _R]])


def _monomials(p):
    x, y, z = np.moveaxis(p, -1, 0)
    one = np.ones_like(x)
    return np.stack([one, x, y, z, x * x, y * y, z * z, x * y, y * z, z * x], -1)


def _derivatives(p):
    x, y, z = np.moveaxis(p, -1, 0)
    o, one = np.zeros_like(x), np.ones_like(x)
    dx = [o, one, o, o, 2 * x, o, o, y, o, z]
    dy = [o, o, one, o, o, 2 * y, o, x, z, o]
    dz = [o, o, o, one, o, o, 2 * z, o, y, x]
    return np.stack([np.stack(d, -1) for d in (dx, dy, dz)], -1)


_CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
_PAIRS = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
_NODES = np.concatenate([_CORNERS, [(_CORNERS[i] + _CORNERS[j]) / 2 for i, j in _PAIRS]])
_SHAPE = np.linalg.inv(_monomials(_NODES))


def principal_energy(model, parameters, s):
    """Return the energy density for principal stretches (..., 3), by textbook formulas."""
    J = s.prod(-1)
    if model == "stable-neo-hookean":
        mu, lame, alpha = parameters[:3]
        i1 = (s**2).sum(-1)
        spherical = 0.5 * lame * ((J - alpha) ** 2 - (1 - alpha) ** 2)
        return 0.5 * mu * (i1 - 3) + spherical - 0.5 * mu * np.log((i1 + 1) / 4)
    c10, c20, c30, c01, kappa = parameters
    bar = s / np.cbrt(J)[..., None]
    y = (bar**2).sum(-1) - 3
    z = (bar**-2.0).sum(-1) - 3  # I2 of unimodular stretches
    return c10 * y + c20 * y**2 + c30 * y**3 + c01 * z + kappa / 2 * (J - 1) ** 2


@dataclass(frozen=True)
class Opinion:
    """Energy and forces of a state.

    Attributes:
        energy: Energy, N mm.
        force: Nodal forces (n, 3) N, by finite differences of the energy along principal stretches.
        least_jacobian: Smallest det F at the quadrature points.
    """

    energy: float
    force: np.ndarray
    least_jacobian: float


def judge(nodes, cells, u, model, parameters):
    """Return energy and nodal forces at displacements u (n, 3) mm."""
    dxi = _derivatives(FOUR)  # (q, 10, 3) of the monomials
    dn = np.einsum("mn,qmd->qnd", _SHAPE, dxi)
    X = nodes[cells]
    jac = np.einsum("qnd,enx->eqxd", dn, X)
    volume = np.linalg.det(jac) / 6 / 4
    grad = np.einsum("qnd,eqdx->eqnx", dn, np.linalg.inv(jac))
    F = np.einsum("eqnx,ena->eqax", grad, X + u[cells])
    U, s, Vt = np.linalg.svd(F)
    J = np.linalg.det(F)
    h = 1e-6
    principal = np.empty_like(s)
    for k in range(3):
        e = np.zeros(3)
        e[k] = h
        up, down = (principal_energy(model, parameters, s + d * e) for d in (1, -1))
        principal[..., k] = (up - down) / (2 * h)
    P = np.einsum("eqak,eqk,eqkx->eqax", U, principal, Vt)
    local = np.einsum("eqax,eqnx,eq->ena", P, grad, volume)
    force = np.zeros_like(nodes)
    np.add.at(force, cells, local)
    energy = float((principal_energy(model, parameters, s) * volume).sum())
    return Opinion(energy, force, float(J.min()))


def faults(nodes, cells, conditions, state, energy, model, parameters):
    """Return the errors of a solved state as a list of sentences.

    Handles must have prescribed rotations, and prescribed or free translations.
    """
    opinion = judge(nodes, cells, state.u, model, parameters)
    problems = []
    if opinion.least_jacobian <= 0:
        problems.append(f"det F is {opinion.least_jacobian:.3g} somewhere")
    if abs(opinion.energy - energy) > 1e-6 * max(opinion.energy, 1e-9):
        problems.append(f"energy {energy:.9g}, not {opinion.energy:.9g}")
    largest = np.abs(opinion.force).max()
    free = np.ones(len(nodes), bool)
    free[conditions.fixed] = False
    if np.abs(state.u[conditions.fixed]).max(initial=0) > 0:
        problems.append("a fixed node moved")
    for h in conditions.handles:
        free[h.nodes] = False
        moved = nodes[h.nodes] + state.u[h.nodes]
        arm = nodes[h.nodes] - h.center
        a, b = arm - arm.mean(0), moved - moved.mean(0)
        angle = np.linalg.norm(h.rotation)
        x, y, z = h.rotation / angle if angle else (0, 0, 0)
        k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turn = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
        if np.abs(b - a @ turn.T).max() > 1e-7:
            problems.append("a handle is not turned as prescribed")
        loose = np.isnan(h.translation)
        net = opinion.force[h.nodes].sum(0)
        if np.abs(net[loose]).max(initial=0) > 1e-5 * largest:
            problems.append("a free handle carries a force")
        shift = moved.mean(0) - h.center - turn @ arm.mean(0)
        if np.abs((shift - h.translation)[~loose]).max(initial=0) > 1e-7:
            problems.append("a handle is not moved as prescribed")
    rest = np.abs(opinion.force[free]).max(initial=0)
    if rest > 1e-5 * largest:
        problems.append(f"a free node carries {rest / largest:.1e} of the largest force")
    return problems
