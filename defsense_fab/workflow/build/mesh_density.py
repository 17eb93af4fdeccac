"""Choose the edge length of the mesh by the accuracy of the cords' signals.

Cords sense neither displacement nor stress, but the elongation of lines through the body. The poses
are solved on ever finer meshes, and the elongations of probing lines are measured on each. Two
successive meshes give the error of the finer one by Richardson extrapolation. With three meshes the
order of convergence is measured, as edges of handles make it lower than that of the elements.
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
from ...mechanics.solver.batch import Solve, solve_all
from ...sensing.response import Response, cord_signals
from .load_cases import Loading, prepare_jobs

LINE_COUNT = 40
SAMPLES_PER_LINE = 200
EDGE_RATIO = 1.5  # between the edge lengths of successive meshes
DEFAULT_ORDER = 1.5  # of convergence, until it is measured
MAX_TETS = 40_000
TETS_PER_CUBE = 8.5  # in the volume of a cube whose side is their edge length
#: Digits of signals that do not depend on the number of threads of the linear solver.
SIGNAL_DECIMALS = 10


@dataclass(frozen=True)
class Trial:
    """A mesh that was tried.

    Attributes:
        edge_length: Edge length, mm.
        mesh: The mesh.
        signals: Signals of the probing lines (pose, line); NaN where the solver did not converge.
        error: Estimated relative error of the signals; NaN if unknown.
    """

    edge_length: float
    mesh: TetMesh
    signals: Float
    error: float


@dataclass(frozen=True)
class DensityChoice:
    """The chosen mesh.

    Attributes:
        chosen: The chosen mesh with its error.
        trials: All meshes that were tried, from coarse to fine.
    """

    chosen: Trial
    trials: tuple[Trial, ...]


def choose_mesh(
    device: Device,
    surface: Surface,
    accuracy: float,
    make: Callable[[float], TetMesh],
    report: Callable[[float, str], None],
    solve: Solve = solve_all,
) -> DensityChoice:
    """Return the coarsest mesh whose estimated signal error is within an accuracy.

    If that takes more than `MAX_TETS`, it is the finest mesh, and its error exceeds the accuracy.

    Args:
        device: The device.
        surface: Surface of the body.
        accuracy: Largest relative error of the signals.
        make: Makes a mesh with an edge length in mm.
        report: Receives the completed fraction and a message.
        solve: `solve_all`, or a function that does the same elsewhere.

    Raises:
        MeshingError: A pose could not be solved on any mesh.
        DeviceError: A region is too small for the finest mesh.
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
        finer = edge / EDGE_RATIO
        is_last = TETS_PER_CUBE * surface.volume / finer**3 > MAX_TETS
        try:
            signals = measure_signals(device, quadratic, locator, lines, solve)
        except DeviceError:  # a region is too small for this mesh
            if is_last:
                raise
            signals = np.full((len(device.poses), len(lines)), np.nan)
        trials.append(Trial(edge, mesh, signals, np.nan))
        trials = estimate_errors(trials)
        accurate = [t for t in trials if t.error <= accuracy]
        if accurate:
            return DensityChoice(accurate[0], tuple(trials))
        if is_last:
            if not np.isfinite(signals).all():
                raise MeshingError(
                    "a pose does not converge on any mesh that was tried",
                    code="pose-not-reached",
                    where="device.toml: mesh.accuracy",
                    action="Give edge_length instead to find out which pose",
                    key="mesh.accuracy",
                )
            return DensityChoice(trials[-1], tuple(trials))
        edge = finer


def coarse_edge(surface: Surface) -> float:
    """Return the edge length of the first trial, mm.

    It is about the thickness of the body, and coarse enough for a second trial.
    """
    a, b, c = (surface.vertices[surface.faces[:, i]] for i in range(3))
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    max_tets = 0.9 * MAX_TETS / EDGE_RATIO**3
    volume = abs(surface.volume)
    return max(2 * volume / area, float(np.cbrt(TETS_PER_CUBE * volume / max_tets)))


def estimate_errors(trials: list[Trial]) -> list[Trial]:
    """Return the trials with errors by Richardson extrapolation between successive ones."""
    gaps = [relative_difference(a.signals - b.signals, b.signals) for a, b in pairwise(trials)]
    if not gaps:
        return trials
    order = DEFAULT_ORDER
    if len(gaps) > 1 and gaps[-1] > 0 and np.isfinite(gaps[-2]):
        order = float(np.clip(np.log(gaps[-2] / gaps[-1]) / np.log(EDGE_RATIO), 0.75, 3.0))
    gain = EDGE_RATIO**order
    finest_error = gaps[-1] / (gain - 1)
    finest = trials[-1].signals
    estimated = []
    for t in trials[:-1]:
        error = relative_difference(t.signals - finest, finest) + finest_error
        estimated.append(Trial(t.edge_length, t.mesh, t.signals, error))
    return [*estimated, Trial(trials[-1].edge_length, trials[-1].mesh, finest, finest_error)]


def relative_difference(difference: Float, signals: Float) -> float:
    """Return the RMS difference relative to the RMS signal of the worst pose.

    Args:
        difference: Differences of signals (pose, line).
        signals: The signals (pose, line).

    Returns:
        The ratio; infinite if a difference is unknown.
    """
    if not np.isfinite(difference).all():
        return np.inf
    scale = np.sqrt((signals**2).mean(axis=1))
    return float((np.sqrt((difference**2).mean(axis=1)) / np.maximum(scale, 1e-12)).max())


def probing_lines(locator: PointLocator, rng: np.random.Generator) -> Float:
    """Return long chords through the body that end a tenth of their length before its surface.

    Args:
        locator: Finds points in the body.
        rng: Draws points and directions.

    Returns:
        Points on the lines (`LINE_COUNT`, `SAMPLES_PER_LINE`, 3) mm.
    """
    nodes = locator.mesh.nodes
    low, high = nodes.min(0), nodes.max(0)
    diagonal = float(np.linalg.norm(high - low))
    points = rng.uniform(low, high, (200 * LINE_COUNT, 3))
    points = points[locator.find(points).depth > 0][: 12 * LINE_COUNT]
    # Mostly along the body, as cords are.
    direction = rng.normal(size=(len(points), 3)) * (high - low) ** 2
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    t = np.linspace(-1, 1, 400)
    along = points[:, None] + diagonal * t[:, None] * direction[:, None]
    inside = locator.find(along.reshape(-1, 3)).depth.reshape(along.shape[:2]) > 0
    middle = len(t) // 2
    ahead = np.where(inside[:, middle:].all(1), middle, inside[:, middle:].argmin(1))
    behind = np.where(inside[:, :middle].all(1), middle, inside[:, :middle][:, ::-1].argmin(1))
    start, end = 0.9 * behind * (t[1] - t[0]), 0.9 * ahead * (t[1] - t[0])
    longest = np.argsort(-(start + end), kind="stable")[:LINE_COUNT]
    s = np.linspace(0, 1, SAMPLES_PER_LINE)[:, None]
    a = (points - diagonal * start[:, None] * direction)[longest, None]
    b = (points + diagonal * end[:, None] * direction)[longest, None]
    return np.asarray(a + s * (b - a))


def measure_signals(
    device: Device,
    mesh: QuadraticMesh,
    locator: PointLocator,
    lines: Float,
    solve: Solve = solve_all,
) -> Float:
    """Solve the poses of a device and return the relative elongation of each line.

    Args:
        device: The device.
        mesh: The mesh.
        locator: Finds points in the mesh.
        lines: Points on the lines (line, sample, 3) mm.
        solve: `solve_all`, or a function that does the same elsewhere.

    Returns:
        Elongations (pose, line); NaN if a pose did not converge.
    """
    plan = [Loading({p.name: 1.0}, (1.0,), False) for p in device.poses]
    _, jobs, _ = prepare_jobs(device, mesh, plan)
    solutions = solve(mesh, Material.from_spec(device.simulated_material), jobs)
    location = locator.find(lines.reshape(-1, 3))
    signals = np.full((len(plan), len(lines)), np.nan)
    for i, results in enumerate(solutions):
        u = results[-1].u
        if u is not None:
            moved = lines + locator.displacement(location, u[None])[0].reshape(lines.shape)
            signals[i] = cord_signals(lines, moved[None], Response.line(1.0))[0]
    return np.asarray(np.round(signals, SIGNAL_DECIMALS))
