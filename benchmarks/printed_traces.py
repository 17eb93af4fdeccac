"""Compare embedded traces with FElupe, where the trace is a second material.

    PEER_PYTHON=peers/bin/python python -m benchmarks.printed_traces [accuracy] [time]

A coupon of 40 x 10 x 6 mm (nu 0.45, 12 MPa) has one trace of 1.2 x 0.8 mm, 2 mm above its middle:
a straight one from x = 3 to 37 mm, a U with legs at y = -3 and 3 mm from x = 3 mm, or a U from
x = 0 (`held-U`, the usual case: a trace starts in the region that is held). One end is fixed. The
other is bent and twisted by 30 degrees, free to move, or pulled by 10 % along the axis. The signal
is the relative elongation of the trace's center line, the shape the displacement of the surface.
The times are CPU seconds of the bar of `fixtures/devices`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.mesh import TetMesh
from defsense_fab.mechanics.elements.material import Material, neo_hookean
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.mechanics.loading.boundary_conditions import BoundaryConditions, RigidHandle
from defsense_fab.mechanics.loading.fibers import Fibers
from defsense_fab.mechanics.solver.batch import solve_all
from defsense_fab.mechanics.solver.load_stepping import solve_ramp
from defsense_fab.store.mesh import load_mesh
from defsense_fab.workflow.build.build import build
from defsense_fab.workflow.build.load_cases import list_loadings, prepare_jobs
from tests.support.grid import grid_of_tets

SIZE, TRACE, HEIGHT = np.array([40.0, 10.0, 6.0]), (1.2, 0.8), 2.0  # mm
YOUNG, NU = 12.0, 0.45
CENTER = np.array([40.0, 0.0, 0.0])
FREE = np.full(3, np.nan)
LOADS = {
    "bend": ([0, -np.deg2rad(30), 0], FREE),
    "twist": ([np.deg2rad(30), 0, 0], FREE),
    "pull": ([0, 0, 0], np.array([4.0, np.nan, np.nan])),
}
PATHS = {
    "straight": np.array([[3.0, 0, HEIGHT], [37, 0, HEIGHT]]),
    "U": np.array([[3.0, -3, HEIGHT], [34, -3, HEIGHT], [34, 3, HEIGHT], [3, 3, HEIGHT]]),
    "held-U": np.array([[0.0, -3, HEIGHT], [34, -3, HEIGHT], [34, 3, HEIGHT], [0, 3, HEIGHT]]),
}
NORMAL = np.array([0.0, 0, 1])
#: Embedded fibers by name: numbers of filaments over width and height, and the linear law or not.
KINDS = {
    "without": None,
    "1 linear": (1, 1, True),
    "1": (1, 1, False),
    "2x2": (2, 2, False),
    "3x3": (3, 3, False),
    "1 shear": (1, 1, False, NU),
    "2x2 shear": (2, 2, False, NU),
}
EDGES = np.array(
    [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]]
)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "parts", nargs="*", default=["accuracy"], help="accuracy, convergence, time"
    )
    parser.add_argument("--moduli", type=float, nargs="+", default=[20.0, 100.0, 300.0])
    parser.add_argument("--edges", type=float, nargs="+", default=[3.0, 1.5], help="of tets, mm")
    parser.add_argument("--step", type=float, default=1.0, help="length of the peer's cells, mm")
    parser.add_argument("--paths", nargs="*", default=list(PATHS))
    parser.add_argument("--keep", type=Path, help="folder that keeps the peer's results")
    options = parser.parse_args()
    if "time" in options.parts:
        show_times()
    with tempfile.TemporaryDirectory() as folder:
        keep = options.keep or Path(folder)
        keep.mkdir(exist_ok=True)
        for name in options.paths:
            for young in options.moduli:
                if "convergence" in options.parts:
                    show_convergence(name, young, options.step, keep)
                if "accuracy" in options.parts:
                    compare(name, young, options.step, options.edges, keep)
    return 0


def show_times() -> None:
    """Print the time of all states of the bar without and with three U-shaped traces."""
    device = load_device(Path("fixtures/devices/bar"))
    mesh = QuadraticMesh.from_linear(load_mesh(build(device, "mesh").folder))
    _, jobs, _ = prepare_jobs(device, mesh, list_loadings(device))
    body = device.simulated_material.young_modulus
    traces = []
    for y in (-8.0, 0, 8):
        path = refine(np.array([[2.0, y, 5], [145, y, 5], [145, y + 3, 5], [2, y + 3, 5]]), 1.0)
        traces.append(path)
    kinds = (None, (1, 1, None), (2, 2, None), (2, 2, NU))
    for kind in kinds * 2:
        fibers = None
        if kind:
            parts = [
                Fibers.of_trace(p, TRACE, NORMAL, (300, YOUNG), body, kind[:2], kind[2])
                for p in traces
            ]
            fibers = parts[0] + parts[1] + parts[2]
        changed = [replace(job, conditions=replace(job.conditions, fibers=fibers)) for job in jobs]
        started_at = time.process_time()
        results = solve_all(mesh, Material.from_spec(device.simulated_material), changed, threads=1)
        seconds = time.process_time() - started_at
        factors = sum(e.statistics.factors for r in results for e in r)
        bad = [e.status for r in results for e in r if e.status != "ok"]
        print(
            f"bar, {len(mesh.cells)} tets, {len(jobs)} jobs, fibers {kind}: {seconds:.2f} s,"
            f" {factors} factorizations, not ok: {bad}",
            flush=True,
        )


def show_convergence(name: str, young: float, step: float, folder: Path) -> None:
    """Print the peer's signals on two meshes."""
    for length, across in ((2 * step, 1), (step, 2), (0.7 * step, 3)):
        nodes, _, signals, seconds = solve_peer(name, young, length, across, folder)
        text = "  ".join(f"{k} {100 * s:.4f} %" for k, s in zip(LOADS, signals, strict=True))
        print(f"{name} {young:g} MPa peer {len(nodes)} nodes: {text}  {seconds.sum():.0f} s")


def compare(name: str, young: float, step: float, edges: list[float], folder: Path) -> None:
    """Print differences of each kind of fiber from the peer, relative to the largest signal."""
    nodes, u, signals, _ = solve_peer(name, young, step, 2, folder)
    largest = np.abs(signals).max()
    lows, highs = nodes.min(0), nodes.max(0)
    on_surface = (np.isclose(nodes, lows) | np.isclose(nodes, highs)).any(axis=1)
    moves = [np.sqrt((w[on_surface] ** 2).sum(1).mean()) for w in u]
    text = "  ".join(f"{k} {100 * s:.3f} %" for k, s in zip(LOADS, signals, strict=True))
    print(f"\n{name}, trace {young:g} MPa; peer: {text}")
    print("edge mm | fibers   | error of signal, % of largest    | shape RMS mm (% of motion) | s")
    for edge in edges:
        mesh = QuadraticMesh.from_linear(coupon(edge))
        locator = PointLocator(mesh)
        path = refine(PATHS[name], 0.25)
        at, surface = locator.find(path), locator.find(nodes[on_surface])
        for kind, setting in KINDS.items():
            fibers = None
            if setting:
                fibers = Fibers.of_trace(
                    PATHS[name],
                    TRACE,
                    NORMAL,
                    (young, YOUNG),
                    None,
                    setting[:2],
                    (*setting, None)[3],
                )
                fibers = replace(fibers, is_linear=setting[2])
            ours, shapes, started_at = [], [], time.perf_counter()
            factors = 0
            for rotation, translation in LOADS.values():
                result = solve(mesh, rotation, translation, fibers)
                factors += result.statistics.factors
                moved = locator.displacement(at, result.u[None])[0]
                ours.append(elongation(path, moved))
                shapes.append(locator.displacement(surface, result.u[None])[0])
            seconds = time.perf_counter() - started_at
            error = 100 * (np.array(ours) - signals) / largest
            rms = [
                np.sqrt(((s - w[on_surface]) ** 2).sum(1).mean())
                for s, w in zip(shapes, u, strict=True)
            ]
            print(
                f"{mesh.edge_length:7.2f} | {kind:8} | "
                + "  ".join(f"{k} {e:+7.3f}" for k, e in zip(LOADS, error, strict=True))
                + " | "
                + "  ".join(f"{r:.4f} ({100 * r / m:.2f})" for r, m in zip(rms, moves, strict=True))
                + f" | {seconds:.1f} s, {factors} factorizations",
                flush=True,
            )


def coupon(edge: float) -> TetMesh:
    """Return the coupon in tets of about this edge length, mm."""
    counts = np.maximum(np.round(SIZE / edge), 1).astype(int)
    lows = np.array([0, -SIZE[1] / 2, -SIZE[2] / 2])
    return grid_of_tets(
        [np.linspace(a, a + s, n + 1) for a, s, n in zip(lows, SIZE, counts, strict=True)]
    )


def solve(mesh, rotation, translation, fibers=None):
    """Solve one load of the coupon by the toolkit."""
    x = mesh.nodes
    base, tip = (np.flatnonzero(np.isclose(x[:, 0], end)) for end in (0, SIZE[0]))
    handle = RigidHandle(tip, CENTER, np.array(rotation, float), translation)
    material = neo_hookean(YOUNG / (2 * (1 + NU)), YOUNG / (3 * (1 - 2 * NU)))
    conditions = BoundaryConditions(base, (handle,), fibers=fibers)
    (result,) = solve_ramp(mesh, material, conditions, [1.0])
    assert result.converged, result.status
    return result


def refine(path: np.ndarray, step: float) -> np.ndarray:
    """Return points of a polyline at most `step` mm apart, its corners included."""
    out = [path[:1]]
    for a, b in pairwise(path):
        count = int(np.ceil(np.linalg.norm(b - a) / step - 1e-9))
        out.append(a + np.linspace(0, 1, count + 1)[1:, None] * (b - a))
    return np.concatenate(out)


def elongation(path: np.ndarray, u: np.ndarray) -> float:
    """Return the relative elongation of a path whose points move by u."""
    length, before = (np.linalg.norm(np.diff(x, axis=0), axis=1).sum() for x in (path + u, path))
    return float(length / before - 1)


def solve_peer(name: str, young: float, step: float, across: int, folder: Path):
    """Return nodes (n, 3), displacements (k, n, 3), signals (k,) and seconds (k,) of FElupe.

    Args:
        name: Name of the path.
        young: Young's modulus of the trace, MPa.
        step: Length of the cells along the coupon, and their largest width, mm.
        across: Number of cells over the trace's width and height.
        folder: Where results are kept.
    """
    nodes, cells, is_trace = resolve(name, step, across)
    file = folder / f"{name}-{young:g}-{step:g}-{across}.npz"
    if not file.exists():
        problem = folder / "problem.npz"
        np.savez(
            problem,
            nodes=nodes,
            cells=cells,
            is_trace=is_trace,
            moduli=[YOUNG, young],
            nu=NU,
            fixed=np.flatnonzero(np.isclose(nodes[:, 0], 0)),
            moved=np.flatnonzero(np.isclose(nodes[:, 0], SIZE[0])),
            center=CENTER,
            rotations=[np.array(r, float) for r, _ in LOADS.values()],
            translations=[t for _, t in LOADS.values()],
        )
        peer = os.environ.get("PEER_PYTHON", sys.executable)
        command = [peer, "-m", "benchmarks.peers.felupe_trace", str(problem), str(file)]
        subprocess.run(command, check=True)
    with np.load(file) as f:
        u, seconds = f["u"], f["seconds"]
    path = refine(PATHS[name], 0.01)
    order = []
    for a, b in pairwise(PATHS[name]):
        t = (nodes - a) @ (b - a) / np.linalg.norm(b - a) ** 2
        on = np.linalg.norm(nodes - a - t[:, None] * (b - a), axis=1) < 1e-6
        on &= (t > -1e-9) & (t < 1 + 1e-9)
        members = np.flatnonzero(on)
        order += list(members[np.argsort(t[members])][1 if order else 0 :])
    assert len(path) > len(order) > 10
    return nodes, u, np.array([elongation(nodes[order], w[order]) for w in u]), seconds


def resolve(name: str, step: float, across: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return nodes, quadratic hexahedra (m, 20), and which of them are in the trace (m,)."""
    path, half = PATHS[name], np.array([TRACE[0], TRACE[0], TRACE[1]]) / 2
    boxes = [
        (
            np.minimum(a, b) - half * [len(path) > 2, 1, 1],
            np.maximum(a, b) + half * [len(path) > 2, 1, 1],
        )
        for a, b in pairwise(path)
    ]
    # The trace ends at the path's ends; corners are square.
    boxes = [
        (np.maximum(low, [path[:, 0].min(), -9, -9]), high) if len(path) > 2 else (low, high)
        for low, high in boxes
    ]
    low = np.array([0, -SIZE[1] / 2, -SIZE[2] / 2])
    axes = []
    for k in range(3):
        marks = {low[k], low[k] + SIZE[k], *path[:, k]}
        for a, b in boxes:
            marks |= {a[k], b[k]}
        marks = sorted(round(m, 9) for m in marks)
        fine = [(a[k], b[k]) for a, b in boxes if b[k] - a[k] < 2]
        grid = [marks[0]]
        for a, b in pairwise(marks):
            if b - a < 1e-6:
                continue
            narrow = any(c - 1e-6 <= a and b <= d + 1e-6 for c, d in fine)
            length = TRACE[0 if k < 2 else 1] / across if narrow else step * (1 if k == 0 else 0.8)
            grid += list(np.linspace(a, b, max(1, int(np.ceil((b - a) / length - 1e-6))) + 1)[1:])
        axes.append(np.array(grid))
    counts = [len(a) for a in axes]
    corner = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    index = np.arange(len(corner)).reshape(counts)
    offsets = [
        (0, 0, 0),
        (1, 0, 0),
        (1, 1, 0),
        (0, 1, 0),
        (0, 0, 1),
        (1, 0, 1),
        (1, 1, 1),
        (0, 1, 1),
    ]
    cells = np.stack(
        [
            index[i : counts[0] - 1 + i, j : counts[1] - 1 + j, k : counts[2] - 1 + k].ravel()
            for i, j, k in offsets
        ],
        axis=1,
    )
    edges = np.sort(cells[:, EDGES].reshape(-1, 2), axis=1)
    unique, inverse = np.unique(edges, axis=0, return_inverse=True)
    nodes = np.concatenate([corner, corner[unique].mean(axis=1)])
    middle = corner[cells].mean(axis=1)
    is_trace = np.zeros(len(cells), bool)
    for a, b in boxes:
        is_trace |= ((middle > a) & (middle < b)).all(axis=1)
    quadratic = np.concatenate([cells, len(corner) + inverse.reshape(-1, 12)], axis=1)
    return nodes, quadratic, is_trace


if __name__ == "__main__":
    raise SystemExit(main())
