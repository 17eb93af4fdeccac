"""Compare the linear solvers: MKL Pardiso, and those for machines without it.

    OMP_NUM_THREADS=1 python -m benchmarks.solvers fixtures/devices/bar fixtures/devices/character
    python -m benchmarks.solvers fixtures/devices/bar --build     # whole builds

Each device is solved on its own mesh and one core. Measured are the first factor of the tangent at
rest, further factors with the same ordering (as all factors of a pose but the first), one solve
(medians of CPU seconds), and the first pose from rest to its end; and the differences of the
solutions. With `--build` the device is built with each solver in copies of its folder: CPU seconds,
predicted error and parts.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from defsense_fab.core.device.device_file import load_device
from defsense_fab.mechanics.elements import tet10
from defsense_fab.mechanics.elements.material import Material
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.mechanics.loading.boundary_conditions import rest_state
from defsense_fab.mechanics.solver.linear_solver import Pardiso, Rslab, SuperLU
from defsense_fab.mechanics.solver.load_stepping import Stepping, follow
from defsense_fab.mechanics.solver.newton import System
from defsense_fab.store.layout import load_layout
from defsense_fab.store.manifest import load_manifest
from defsense_fab.store.mesh import load_mesh
from defsense_fab.workflow.build.build import build
from defsense_fab.workflow.build.load_cases import list_loadings, prepare_jobs

SWITCH = "DEFSENSE_SOLVER"
SOLVERS = {kind.name: {SWITCH: kind.__name__.lower()} for kind in (Pardiso, Rslab, SuperLU)}


@contextmanager
def copied(device: Path) -> Iterator[Path]:
    """Yield a copy of the device's folder without its build."""
    with tempfile.TemporaryDirectory() as folder:
        to = Path(folder, device.name)
        shutil.copytree(device, to, ignore=shutil.ignore_patterns("build", ".build-*"))
        yield to


def seconds(work: Callable[[], object], repeat: int) -> float:
    """Return the median of CPU seconds."""
    times_s = []
    for _ in range(repeat):
        start = time.process_time()
        work()
        times_s.append(time.process_time() - start)
    return float(np.median(times_s))


def equations(device: Path, repeat: int) -> None:
    """Solve the same matrix and the same pose by each solver."""
    with copied(device) as folder:
        read = load_device(folder)
        mesh = QuadraticMesh.from_linear(load_mesh(build(read, "mesh").folder))
        law = Material.from_spec(read.material)
        _, todo, _ = prepare_jobs(read, mesh, list_loadings(read))
    goal = todo[0].conditions
    times_s, solutions = {}, {}
    for name, environment in SOLVERS.items():
        os.environ.pop(SWITCH, None)
        os.environ.update(environment)
        system = System(mesh, law, goal)
        if system.solver.name != name:
            sys.exit(f"{name} is not to be had here, but {system.solver.name}")
        start = rest_state(goal, len(mesh.nodes))
        matrix = system.reduction.matrix(
            start, law, tet10.deformation_gradient(mesh, start.u, 1), 1.0,
            system.loads.blocks(goal, start.u), None, 1,
        )  # fmt: skip
        right = np.random.default_rng(0).normal(size=matrix.shape[0])
        first = seconds(lambda s=system, m=matrix: s.solver.factor(m), 1)
        again = seconds(lambda s=system, m=matrix: s.solver.factor(m), repeat)
        solved = seconds(lambda s=system, r=right: s.solver.solve(r), repeat)
        x = system.solver.solve(right)
        system.close()

        def pose() -> object:
            fresh_system = System(mesh, law, goal)
            try:
                return follow(
                    fresh_system,
                    rest_state(goal, len(mesh.nodes)),
                    goal,
                    stepping=Stepping(check=False),
                )[-1]
            finally:
                fresh_system.close()

        u = pose().u  # compiled now
        times_s[name] = (first, again, solved, seconds(pose, repeat))
        solutions[name] = (x, u)
    print(f"\n{device.name}: {len(mesh.cells)} tets, {matrix.shape[0]} unknowns, CPU s, one core")
    print(f"{'':<16}{'first factor':>14}{'factor':>10}{'solve':>10}{'pose':>10}")
    for name, times in times_s.items():
        print(f"{name:<16}{times[0]:>14.3f}" + "".join(f"{t:>10.3f}" for t in times[1:]))
    reference, (x, u) = times_s[Pardiso.name], solutions[Pardiso.name]
    for name in [n for n in SOLVERS if n != Pardiso.name]:
        ratios = [b / a for a, b in zip(reference, times_s[name], strict=True)]
        y, v = solutions[name]
        print(f"{name:<16}{ratios[0]:>13.1f}x" + "".join(f"{r:>9.1f}x" for r in ratios[1:])
              + f"  difference {np.abs(x - y).max() / np.abs(x).max():.0e} of the largest, pose "
              f"{np.abs(u - v).max():.0e} mm")  # fmt: skip


def builds(device: Path) -> None:
    """Build the device with each solver, in separate processes."""
    print(f"\n{device.name}, built to the end")
    for name, environment in SOLVERS.items():
        with copied(device) as folder:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            start = time.perf_counter()
            subprocess.run(
                [sys.executable, "-m", "defsense_fab.cli.main", "build", str(folder)],
                env={k: v for k, v in os.environ.items() if k != SWITCH} | environment,
                check=True, stdout=subprocess.DEVNULL,
            )  # fmt: skip
            wall = time.perf_counter() - start
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            layout, manifest = load_layout(folder / "build"), load_manifest(folder / "build")
            unseen = ", ".join(f"{k} {v:.3f}" for k, v in layout.unseen.items())
            print(f"{name:<16}{cpu:>8.0f} CPU s{wall:>7.0f} s  {len(manifest.parts)} parts, "
                  f"{len(layout.sensors)} cords; unseen states, mm: {unseen}; "
                  f"as built {layout.band.median:.3f}", flush=True)  # fmt: skip


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("devices", nargs="+", type=Path)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--build", action="store_true", help="build each with both")
    arguments = parser.parse_args()
    for device in arguments.devices:
        if arguments.build:
            builds(device)
        else:
            equations(device, arguments.repeat)


if __name__ == "__main__":
    main()
