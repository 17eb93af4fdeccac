"""A handle with free translation against the same pose by penalty in NGSolve.

PEER_PYTHON=/path/to/python python -m benchmarks.free_translation
"""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.agreement import ROOT, compare, interpreter
from benchmarks.robustness import material
from benchmarks.speed import bar, pose
from defsense_fab.mechanics.elements import tet10
from defsense_fab.mechanics.solver.load_stepping import solve_ramp


def main() -> None:
    mesh, law = bar(1500), material(0.45)
    for degrees, axis in ((60, [0, -1, 0]), (60, [1, 0, 0])):
        goal = pose(mesh, np.deg2rad(degrees) * np.array(axis))
        (handle,) = goal.handles
        result = solve_ramp(mesh, law, goal, [1.0])[-1]
        F = tet10.deformation_gradient(mesh, result.u)
        force = tet10.forces(mesh, law, F)
        net = np.abs(force[handle.nodes].sum(0)).max() / np.abs(force).max()
        with tempfile.TemporaryDirectory() as scratch:
            problem, answer = Path(scratch) / "problem.npz", Path(scratch) / "answer.npz"
            np.savez(
                problem,
                nodes=mesh.nodes,
                cells=mesh.cells,
                tip=np.isin(mesh.cells, handle.nodes).all(axis=1),
                mu=law.shear,
                kappa=law.bulk,
                fixed=goal.fixed,
                angle=handle.rotation,
            )
            command = [interpreter(), "-m", "benchmarks.peers.penalty", str(problem), str(answer)]
            subprocess.run(command, cwd=ROOT, check=True)
            with np.load(answer) as data:
                found = compare(mesh, result.u, data["u"])
        print(
            f"{degrees} degrees about {axis}: resultant {net:.1e} of the largest nodal force;"
            f" penalty within {found.displacement:.2g} mm, signals within {found.signal:.3%}"
        )


if __name__ == "__main__":
    main()
