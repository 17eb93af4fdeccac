"""The edge length that keeps the signals of cords within a wanted accuracy.

What matters here is neither displacement nor stress but the elongation of lines through the body.
The poses are solved on ever finer meshes, probing lines are measured on each, and two neighbouring
meshes tell by Richardson's extrapolation how far the finer one is from the limit. The order of
convergence is measured where there are three meshes: the edges of handles make it less than
the elements promise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.errors import DeviceError, MeshingError
from ...core.mesh import Surface, TetMesh
from ...mechanics.elements.material import Material
from ...mechanics.elements.point_location import PointLocator
from ...mechanics.elements.tet10 import QuadraticMesh
from ...mechanics.solver.batch import solve_all
from ...sensing.response import Response, cord_signals
from .load_cases import Loading, jobs

LINES = 40
SAMPLES = 200  # on each line
RATIO = 1.5  # of edge lengths between meshes
ORDER = 1.5  # of convergence, until it is measured
MOST_TETS = 40_000


@dataclass(frozen=True)
class Trial:
    """One mesh: its `signals` (pose, line), relative `error` estimated for them (NaN: unknown)."""

    edge_length: float
    mesh: TetMesh
    signals: Float
    error: float


@dataclass(frozen=True)
class DensityChoice:
    """The mesh taken, the accuracy that it reaches, and all that were tried."""

    taken: Trial
    trials: tuple[Trial, ...]


def choose(
    device: Device,
    surface: Surface,
    accuracy: float,
    make: Callable[[float], TetMesh],
    report: Callable[[float, str], None],
) -> DensityChoice:
    """The coarsest mesh tried whose estimated signal error is within `accuracy`.

    Where MOST_TETS do not suffice, the finest one; its error then says so. Raises MeshingError
    where no mesh could be solved.
    """
    edge = coarse_edge(surface)
    lines: Float | None = None
    trials: list[Trial] = []
    while True:
        report(min(0.9, 0.2 * len(trials)), f"trying an edge length of {edge:.3g} mm")
        mesh = make(edge)
        quadratic = QuadraticMesh.from_linear(mesh)
        locator = PointLocator(quadratic)
        if lines is None:
            lines = probing_lines(locator, np.random.default_rng(0))
        finer = edge / RATIO
        last = 8.5 * surface.volume / finer**3 > MOST_TETS
        try:
            measured = _measure(device, quadratic, locator, lines)
        except DeviceError:  # a region too small for this mesh
            if last:
                raise
            measured = np.full((len(device.poses), len(lines)), np.nan)
        trials.append(Trial(edge, mesh, measured, np.nan))
        trials = estimate(trials)
        known = [t for t in trials if t.error <= accuracy]
        if known:
            return DensityChoice(known[0], tuple(trials))
        if last:
            if not np.isfinite(measured).all():
                raise MeshingError(
                    "device.toml: mesh.accuracy: a pose does not converge on any mesh that was"
                    " tried; give edge_length instead to see which one"
                )
            return DensityChoice(trials[-1], tuple(trials))
        edge = finer


def coarse_edge(surface: Surface) -> float:
    """Edge length (mm) of the first trial: about the thickness, and coarse enough for a second."""
    a, b, c = (surface.vertices[surface.faces[:, i]] for i in range(3))
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    most = 0.9 * MOST_TETS / RATIO**3
    return max(2 * abs(surface.volume) / area, float(np.cbrt(8.5 * abs(surface.volume) / most)))


def estimate(trials: list[Trial]) -> list[Trial]:
    """The trials with errors by Richardson's extrapolation between neighbours."""
    gaps = [_relative(a.signals - b.signals, b.signals) for a, b in pairwise(trials)]
    if not gaps:
        return trials
    order = ORDER
    if len(gaps) > 1 and gaps[-1] > 0 and np.isfinite(gaps[-2]):
        order = float(np.clip(np.log(gaps[-2] / gaps[-1]) / np.log(RATIO), 0.75, 3.0))
    gain = RATIO**order
    limit = gaps[-1] / (gain - 1)  # of the finest one
    last = trials[-1].signals
    out = []
    for t in trials[:-1]:
        away = _relative(t.signals - last, last) + limit
        out.append(Trial(t.edge_length, t.mesh, t.signals, away))
    return [*out, Trial(trials[-1].edge_length, trials[-1].mesh, last, limit)]


def _relative(difference: Float, signal: Float) -> float:
    """RMS over the lines relative to the RMS signal, of the worst pose."""
    if not np.isfinite(difference).all():
        return np.inf
    scale = np.sqrt((signal**2).mean(axis=1))
    return float((np.sqrt((difference**2).mean(axis=1)) / np.maximum(scale, 1e-12)).max())


def probing_lines(locator: PointLocator, rng: np.random.Generator) -> Float:
    """Long chords through the body, (LINES, SAMPLES, 3) mm, that end a tenth before its surface."""
    nodes = locator.mesh.nodes
    low, high = nodes.min(0), nodes.max(0)
    reach = float(np.linalg.norm(high - low))
    points = rng.uniform(low, high, (200 * LINES, 3))
    points = points[locator.find(points).depth > 0][: 12 * LINES]
    # Along the body rather than across it: that is where cords run.
    direction = rng.normal(size=(len(points), 3)) * (high - low) ** 2
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    t = np.linspace(-1, 1, 400)
    along = points[:, None] + reach * t[:, None] * direction[:, None]
    inside = locator.find(along.reshape(-1, 3)).depth.reshape(along.shape[:2]) > 0
    middle = len(t) // 2
    ahead = np.where(inside[:, middle:].all(1), middle, inside[:, middle:].argmin(1))
    behind = np.where(inside[:, :middle].all(1), middle, inside[:, :middle][:, ::-1].argmin(1))
    start, end = 0.9 * behind * (t[1] - t[0]), 0.9 * ahead * (t[1] - t[0])
    longest = np.argsort(-(start + end), kind="stable")[:LINES]
    s = np.linspace(0, 1, SAMPLES)[:, None]
    a = (points - reach * start[:, None] * direction)[longest, None]
    b = (points + reach * end[:, None] * direction)[longest, None]
    return np.asarray(a + s * (b - a))


def _measure(device: Device, mesh: QuadraticMesh, locator: PointLocator, lines: Float) -> Float:
    """Relative elongation of each line in each pose (pose, line); NaN where not reached."""
    plan = [Loading({p.name: 1.0}, (1.0,), False) for p in device.poses]
    _, todo, _ = jobs(device, mesh, plan)
    solved = solve_all(mesh, Material.from_spec(device.material), todo)
    at = locator.find(lines.reshape(-1, 3))
    out = np.full((len(plan), len(lines)), np.nan)
    for i, results in enumerate(solved):
        u = results[-1].u
        if u is not None:
            moved = lines + locator.displacement(at, u[None])[0].reshape(lines.shape)
            out[i] = cord_signals(lines, moved[None], Response.line(1.0))[0]
    return out
