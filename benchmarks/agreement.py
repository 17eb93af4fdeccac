"""Compare poses of three bodies with independent solvers on the same mesh and energy.

    python -m benchmarks.agreement                       # CalculiX, 90 degrees, nu 0.45 and 0.49
    PEER_PYTHON=/path/to/python python -m benchmarks.agreement --peer ngsolve

Our handles are free in translation. The peer gets the path that they take as a prescribed path.
FElupe (GPL) and NGSolve (LGPL) are imported by the interpreter PEER_PYTHON, by default this one;
CalculiX is the program `ccx`.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.robustness import BODIES, body, clamp, material
from defsense_fab.mechanics.elements.material import Material
from defsense_fab.mechanics.elements.point_location import PointLocator
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.mechanics.elements.threads import count_cores
from defsense_fab.mechanics.loading.boundary_conditions import BoundaryConditions
from defsense_fab.mechanics.solver.load_stepping import solve_ramp
from defsense_fab.sensing.response import Response, cord_signals
from defsense_fab.workflow.build.mesh_density import probing_lines

ROOT = Path(__file__).parents[1]
#: Load fractions at which the handle's path is handed over.
PATH = 8


@dataclass(frozen=True)
class Peer:
    """The result of a peer.

    Attributes:
        u: Displacements (n, 3) mm.
        stats: The peer's own statistics.
    """

    u: np.ndarray
    stats: dict


@dataclass(frozen=True)
class Agreement:
    """Differences between two solutions.

    Attributes:
        displacement: Largest distance of any node, mm.
        signal: Largest difference of a line's signal, relative to the RMS signal of the pose.
    """

    displacement: float
    signal: float


def installed(peer: str) -> bool:
    """Return whether a peer is installed."""
    if peer == "calculix":
        return shutil.which("ccx") is not None
    process = subprocess.run([interpreter(), "-c", f"import {peer}"], capture_output=True)
    return process.returncode == 0


def interpreter() -> str:
    """Return the Python interpreter of the peers."""
    return os.environ.get("PEER_PYTHON", sys.executable)


def ask(
    peer: str,
    mesh: QuadraticMesh,
    law: Material,
    conditions: BoundaryConditions,
    shifts: np.ndarray,
    increments: int,
) -> Peer:
    """Return the solution of a peer for the given path of the handle.

    Args:
        peer: Name of the peer.
        mesh: The mesh.
        law: The material.
        conditions: Fixed nodes, and one handle with its rotation.
        shifts: Displacements (k + 1, 3) mm of the handle's center, from rest to the full load.
        increments: Number of load increments.

    Raises:
        RuntimeError: The peer does not converge.
    """
    (handle,) = conditions.handles
    with tempfile.TemporaryDirectory() as scratch:
        problem, result = Path(scratch) / "problem.npz", Path(scratch) / "result.npz"
        np.savez(
            problem,
            nodes=mesh.nodes,
            cells=mesh.cells,
            mu=law.shear,
            kappa=law.bulk,
            fixed=conditions.fixed,
            moved=handle.nodes,
            angle=handle.rotation,
            centre=handle.center,
            centre_path=shifts,
        )
        command = [interpreter(), "-m", "benchmarks.peers.run", peer, str(problem), str(result)]
        process_result = subprocess.run(
            [*command, "--increments", str(increments)], cwd=ROOT, capture_output=True, text=True
        )
        if process_result.returncode:
            raise RuntimeError(process_result.stderr.strip()[-300:])
        with np.load(result) as data:
            return Peer(data["u"], json.loads(str(data["stats"])))


def solve(mesh: QuadraticMesh, law: Material, conditions: BoundaryConditions) -> tuple:
    """Return our displacements (n, 3) mm, and the path (PATH + 1, 3) mm of the handle's center."""
    fractions = [(i + 1) / PATH for i in range(PATH)]
    results = solve_ramp(mesh, law, conditions, fractions, threads=count_cores())
    if not results[-1].converged:
        raise RuntimeError(f"not reached: {results[-1]}")
    shifts = np.array([np.zeros(3), *(r.state.translations[0] for r in results)])
    return results[-1].u, shifts


def compare(mesh: QuadraticMesh, a: np.ndarray, b: np.ndarray) -> Agreement:
    """Return the differences between two displacements (n, 3) mm."""
    locator = PointLocator(mesh)
    lines = probing_lines(locator, np.random.default_rng(0))
    at = locator.find(lines.reshape(-1, 3))
    moved = locator.displacement(at, np.stack([a, b])).reshape(2, *lines.shape)
    ours, theirs = (cord_signals(lines, (lines + m)[None], Response.line(1.0))[0] for m in moved)
    scale = np.sqrt((ours**2).mean())
    return Agreement(
        float(np.linalg.norm(a - b, axis=1).max()), float(np.abs(ours - theirs).max() / scale)
    )


def poses(name: str) -> dict[str, np.ndarray]:
    """Return rotation vectors for 90 degrees of bend and twist about the body's long axis."""
    axis = np.array(BODIES[name][3], float)
    return {"bend 90": np.pi / 2 * np.roll(axis, 1), "twist 90": np.pi / 2 * axis}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--peer", default="calculix", choices=("calculix", "felupe", "ngsolve"))
    parser.add_argument(
        "--increments", type=int, default=0, help="0: one of CalculiX, 10 of others"
    )
    parser.add_argument("--edge", type=float, default=1.3, help="factor on the edge lengths")
    options = parser.parse_args()
    if not installed(options.peer):
        sys.exit(f"{options.peer} is not installed")
    increments = options.increments or (1 if options.peer == "calculix" else 10)
    for name, (fixed, moved, _, _) in BODIES.items():
        mesh, regions = body(name, options.edge)
        for nu in (0.45, 0.49):
            for title, rotation in poses(name).items():
                goal = clamp(mesh, regions, fixed, moved[0], rotation, np.full(3, np.nan))
                law = material(nu)
                ours, shifts = solve(mesh, law, goal)
                title_text = f"{name} ({len(mesh.cells)} tets), {title}, nu {nu}: "
                try:
                    theirs = ask(options.peer, mesh, law, goal, shifts, increments)
                except RuntimeError as error:
                    print(title_text + f"the peer failed: {error}", flush=True)
                    continue
                agreement = compare(mesh, ours, theirs.u)
                print(
                    title_text
                    + f"displacement within {agreement.displacement:.2g} mm, signals within"
                    f" {agreement.signal:.2%} ({theirs.stats['version']})",
                    flush=True,
                )


if __name__ == "__main__":
    main()
