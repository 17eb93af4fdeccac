"""Measure how fast poses are solved: against peers, on growing meshes, for edits, at points.

    python -m benchmarks.speed                    # all parts, about 15 minutes on 2 cores
    python -m benchmarks.speed peers --repeat 3
    python -m benchmarks.speed growth --before OTHER_CHECKOUT
    PEER_PYTHON=/path/to/python python -m benchmarks.speed peers    # Python of FElupe and NGSolve

The body is a bar of 150 x 30 x 15 mm, held at both ends. Times are medians after a warm-up. Peers
that are not installed are skipped. Peers get the same mesh, energy, quadrature and handle path, and
the best of several numbers of equal increments. The signals then agree to several digits: equal
meshes have equal errors, which the table shows against a finer mesh.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks import agreement, layouts
from benchmarks.robustness import material
from defsense_fab.mechanics.elements import tet10
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.mechanics.elements.threads import count_cores
from defsense_fab.mechanics.loading.boundary_conditions import (
    BoundaryConditions,
    RigidHandle,
    rest_state,
)
from defsense_fab.mechanics.solver.batch import Job, solve_all
from defsense_fab.mechanics.solver.interactive import InteractiveSolver
from defsense_fab.mechanics.solver.load_stepping import Stepping, follow
from defsense_fab.mechanics.solver.newton import System
from defsense_fab.sensing.response import Response, cord_signals
from defsense_fab.workflow.build.mesh_density import probing_lines
from tests.support.grid import grid_of_tets

LOW, HIGH = np.array([0, -15, -7.5]), np.array([150, 15, 7.5])
FREE = np.full(3, np.nan)
TETS = 2520
#: Increments to try for a peer, until one converges to our solution.
TRIES = {"calculix": (1, 4), "felupe": (4, 5, 6, 8, 9, 10, 12), "ngsolve": (4, 5, 6, 8, 9, 10, 12)}


def bar(tets: int) -> QuadraticMesh:
    """Return a mesh of about `tets` tetrahedra, with nodes on the planes where the clamps end."""
    k = (tets / 2520) ** (1 / 3)
    ends, middle, across, up = (max(1, round(n * k)) for n in (2, 24, 5, 3))
    axes = [
        np.concatenate(
            [
                np.linspace(0, 10, ends + 1)[:-1],
                np.linspace(10, 140, middle + 1),
                np.linspace(140, 150, ends + 1)[1:],
            ]
        ),
        np.linspace(-15, 15, across + 1),
        np.linspace(-7.5, 7.5, up + 1),
    ]
    return QuadraticMesh.from_linear(grid_of_tets(axes))


def pose(mesh: QuadraticMesh, rotation) -> BoundaryConditions:
    """Return conditions that hold one end and rotate the other, with free translation."""
    x = mesh.nodes[:, 0]
    tip = np.flatnonzero(x >= 140 - 1e-6)
    handle = RigidHandle(tip, np.array([145.0, 0, 0]), np.array(rotation, float), FREE)
    return BoundaryConditions(np.flatnonzero(x <= 10 + 1e-6), (handle,))


POSES = {"bend 90": [0, -np.pi / 2, 0], "twist 90": [np.pi / 2, 0, 0]}


def from_rest(mesh, law, goal):
    """Solve from rest; return the result and the seconds, with set-up and analysis."""
    start = time.perf_counter()
    system = System(mesh, law, goal, count_cores())
    result = follow(
        system, rest_state(goal, len(mesh.nodes)), goal, stepping=Stepping(check=False)
    )[-1]
    seconds = time.perf_counter() - start
    system.close()
    return result, seconds


def line_signals(mesh, u, lines):
    """Return the signals of lines at displacements u."""
    locator = PointLocator(mesh)
    moved = locator.displacement(locator.find(lines.reshape(-1, 3)), u[None])[0]
    return cord_signals(lines, (lines + moved.reshape(lines.shape))[None], Response.line(1.0))[0]


def peers(repeat: int) -> None:
    """Compare rest to 90 degrees with every installed peer."""
    mesh, fine = bar(TETS), bar(8 * TETS)
    lines = probing_lines(PointLocator(fine), np.random.default_rng(0))
    print(f"from rest to 90 degrees, {len(mesh.cells)} quadratic tets, {count_cores()} cores")
    print(f"{'':<24}{'increments':>11}{'solves':>8}{'s':>8}{'ratio':>7}  signal against the finer")
    for nu in (0.45, 0.49):
        law = material(nu)
        for title, rotation in POSES.items():
            goal = pose(mesh, rotation)
            from_rest(mesh, law, goal)
            runs = [from_rest(mesh, law, goal) for _ in range(repeat)]
            own_result, seconds = runs[0][0], float(np.median([r[1] for r in runs]))
            true = line_signals(fine, from_rest(fine, law, pose(fine, rotation))[0].u, lines)

            def error(u, true=true):
                difference = line_signals(mesh, u, lines) - true
                return f"{np.sqrt((difference**2).mean() / (true**2).mean()):.3%}"

            print(f"{title}, nu {nu}")
            s = own_result.statistics
            print(
                f"{'  defsense-fab':<24}{s.steps:>11}{s.iterations:>8}{seconds:>8.2f}{1:>7}"
                f"  {error(own_result.u)}"
            )
            _, shifts = agreement.solve(mesh, law, goal)
            for peer in TRIES:
                if agreement.installed(peer):
                    _one_peer(peer, mesh, law, goal, shifts, own_result.u, seconds, repeat, error)


def _one_peer(peer, mesh, law, goal, shifts, own_result, seconds, repeat, error) -> None:
    for increments in TRIES[peer]:
        try:
            peer_result = agreement.ask(peer, mesh, law, goal, shifts, increments)
        except RuntimeError:
            continue
        if np.abs(peer_result.u - own_result).max() > 0.05:  # another equilibrium
            continue
        more = [agreement.ask(peer, mesh, law, goal, shifts, increments) for _ in range(repeat - 1)]
        theirs = float(np.median([f.stats["seconds"] for f in (peer_result, *more)]))
        print(
            f"{'  ' + peer:<24}{increments:>11}{peer_result.stats['iterations']:>8}{theirs:>8.2f}"
            f"{theirs / seconds:>7.1f}  {error(peer_result.u)}",
            flush=True,
        )
        return
    print(f"{'  ' + peer:<24} does not converge with {TRIES[peer]} increments", flush=True)


def parts_of_an_iteration() -> None:
    """Measure the parts of a Newton iteration."""
    mesh, law = bar(TETS), material(0.45)
    goal = pose(mesh, POSES["bend 90"])
    system = System(mesh, law, goal, count_cores())
    state = rest_state(goal, len(mesh.nodes))
    F = tet10.deformation_gradient(system.reduction.active, state.u, count_cores())
    table: dict[str, list[float]] = {}

    def clock(name, work):
        start = time.perf_counter()
        out = work()
        table.setdefault(name, []).append(time.perf_counter() - start)
        return out

    right = np.ones(system.reduction.size)
    for _ in range(9):
        matrix = clock(
            "assembly, true Hessian",
            lambda: system.reduction.matrix(state, law, F, False, [], None, count_cores()),
        )
        clock(
            "assembly, projected",
            lambda: system.reduction.matrix(state, law, F, True, [], None, count_cores()),
        )
        clock("factorisation", lambda: system.solver.factor(matrix))  # noqa: B023
        clock("solve", lambda: system.solver.solve(right))
        clock("energy", lambda: tet10.energy(system.reduction.active, law, F, count_cores()))
        clock("forces", lambda: tet10.forces(system.reduction.active, law, F, count_cores()))
    print(f"an iteration, {len(mesh.cells)} tets, {system.reduction.size} unknowns")
    for name, seconds in table.items():
        print(f"  {name:<24}{1e3 * np.median(seconds):7.1f} ms")


def edits(repeat: int) -> None:
    """Measure changes of a pose at 60 degrees by 5 and 10: the coarse solution and the fine one."""
    fine, coarse = bar(TETS), bar(TETS // 8)
    print(f"edits, {len(fine.cells)} tets (coarse: {len(coarse.cells)})")
    for nu in (0.45, 0.49):
        for title, rotation in POSES.items():
            session = InteractiveSolver(coarse, fine, material(nu), count_cores())
            for step in (5, 10):
                first, both = [], []
                for k in range(2 * repeat + 1):
                    degrees = 60 + (step if k % 2 else 0)
                    turn = np.array(rotation) / 90 * degrees
                    start = time.perf_counter()
                    session.edit(
                        lambda mesh, turn=turn: pose(mesh, turn),
                        lambda u, start=start, first=first: first.append(
                            time.perf_counter() - start
                        ),
                        check=False,
                    )
                    both.append(time.perf_counter() - start)
                print(
                    f"  {title}, nu {nu}, {step} degrees: coarse {np.median(first[1:]):.3f} s, fine"
                    f" {np.median(both[1:]):.3f} s (largest {max(first[1:]):.3f},"
                    f" {max(both[1:]):.3f})"
                )
            session.close()


def points(repeat: int) -> None:
    """Locate 50,000 points and evaluate gradients there, next to libigl's tree."""
    import igl

    mesh = bar(100_000)
    x = np.random.default_rng(0).uniform(LOW, HIGH, (50_000, 3))
    u = np.random.default_rng(1).normal(size=(1, len(mesh.nodes), 3))
    corners = np.ascontiguousarray(mesh.cells[:, :4])
    tree = igl.AABB()
    tree.init(mesh.nodes, corners)
    ours, build, theirs = [], [], []
    for _ in range(repeat + 1):
        start = time.perf_counter()
        locator = PointLocator(mesh)
        ready = time.perf_counter()
        at = locator.find(x)
        locator.displacement(at, u)
        locator.gradient(at, u)
        end = time.perf_counter()
        tree.find_element(x) if hasattr(tree, "find_element") else igl.in_element(
            mesh.nodes, corners, x, tree
        )
        build.append(ready - start)
        ours.append(end - ready)
        theirs.append(time.perf_counter() - end)
    print(
        f"50,000 points in {len(mesh.cells)} tets, {(at.depth < -1e-9).sum()} missed: found and"
        f" evaluated with gradients in {np.median(ours[1:]):.3f} s, grid {np.median(build[1:]):.3f}"
        f" s; libigl's tree finds them (alone) in {np.median(theirs[1:]):.3f} s"
    )


def growth(before: Path | None) -> None:
    """Print cost against size with fitted orders: sizes of meshes, numbers of poses, layouts.

    Sizes are solved in separate processes, also by the code in the folder `before`, in turns.
    """
    print("from rest to 90 degrees of bend, CPU s of all threads; s on the clock")
    rows = []
    for size in (2_000, 4_000, 8_000, 16_000, 30_000, 50_000):
        rows.append(_solve_size(size, Path.cwd()))
        tets, dof, seconds, used, memory = rows[-1]
        line = f"  {tets:6.0f} tets, {dof:7.0f} unknowns: {used:6.2f} CPU s, {seconds:6.2f} s"
        line += f", {memory:5.2f} GB"
        if before is not None:
            _, _, clock, theirs, _ = _solve_size(size, before)
            line += f"; before {theirs:6.2f} CPU s, {clock:6.2f} s, {theirs / used:.2f} times"
        print(line, flush=True)
    table = np.array(rows)
    orders = [order(table[:, 0], table[:, k]) for k in (3, 4)]
    print(f"  orders: CPU time {orders[0]:.2f}, memory {orders[1]:.2f}")
    mesh, times, counts = bar(TETS), [], (5, 10, 20)
    for count in counts:
        turns = np.linspace(10, 60, count)
        jobs = [Job(pose(mesh, [0, -np.radians(t), 0]), (0.5, 1.0)) for t in turns]
        started = time.process_time()
        solve_all(mesh, material(0.45), jobs)
        times.append(time.process_time() - started)
        print(f"  {count} poses of {len(mesh.cells)} tets: {times[-1]:.2f} CPU s", flush=True)
    print(f"  order in the number of poses: {order(counts, times):.2f}")
    layouts.large_layouts()


def order(sizes, costs) -> float:
    """Return the fitted exponent of the growth of costs with sizes."""
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def _solve_size(size: int, root: Path) -> list[float]:
    """Return what `one` prints, of the code in a folder."""
    ended = subprocess.run(
        [sys.executable, str(Path(__file__).resolve()), "one", "--size", str(size)],
        capture_output=True,
        text=True,
        check=True,
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root)},
    )
    return [float(v) for v in ended.stdout.split()]


def one(size: int) -> None:
    """Print tets, unknowns, seconds, CPU s, and the peak memory of the process in GB."""
    small = bar(600)
    from_rest(small, material(0.45), pose(small, POSES["bend 90"]))  # loads the libraries
    mesh = bar(size)
    goal = pose(mesh, POSES["bend 90"])
    started = time.process_time()
    _, seconds = from_rest(mesh, material(0.45), goal)
    used = time.process_time() - started
    # Not ru_maxrss, which starts from that of the process that started this one.
    status = Path("/proc/self/status").read_text()
    peak = int(status.split("VmHWM:")[1].split()[0]) / 2**20
    print(len(mesh.cells), 3 * len(mesh.nodes), seconds, used, peak)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts = ("peers", "iteration", "edits", "points", "growth", "one")
    parser.add_argument("part", nargs="*", help=f"of {', '.join(parts[:-1])}; all if none is named")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--size", type=int, default=2000)
    parser.add_argument("--before", type=Path, help="another checkout to compare growth with")
    options = parser.parse_args()
    for part in options.part or parts[:-1]:
        {
            "peers": lambda: peers(options.repeat),
            "iteration": parts_of_an_iteration,
            "edits": lambda: edits(options.repeat),
            "points": lambda: points(options.repeat),
            "growth": lambda: growth(options.before),
            "one": lambda: one(options.size),
        }[part]()


if __name__ == "__main__":
    main()
