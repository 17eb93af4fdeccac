"""Find how large a pose the solver can solve: extremes and random poses, checked independently.

    python -m benchmarks.robustness                # extremes and 60 random poses, seed 0
    python -m benchmarks.robustness --random 200 --seed 7 --edge 1.0

Bodies are fixtures/devices/bar, blob and character. A pose is solved if its status is ok and
`independent.faults` finds no error; the status of any other pose must not be ok.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from benchmarks.independent import faults
from defsense_fab.core.device.device_file import load_device
from defsense_fab.geometry.bodies.body import load_body
from defsense_fab.geometry.bodies.meshing.region_conforming import conform_to_regions
from defsense_fab.geometry.bodies.meshing.tetrahedra import tetrahedralize
from defsense_fab.mechanics.elements.material import (
    Material,
    neo_hookean,
    split,
    stable_neo_hookean,
)
from defsense_fab.mechanics.elements.tet10 import QuadraticMesh
from defsense_fab.mechanics.elements.threads import count_cores
from defsense_fab.mechanics.loading.boundary_conditions import BoundaryConditions, RigidHandle
from defsense_fab.mechanics.solver.load_stepping import Equilibrium, Status, solve_ramp

DEVICES = Path(__file__).parents[1] / "fixtures" / "devices"
#: Region held, regions moved, edge length (mm), long direction.
BODIES = {
    "bar": ("base", ("tip",), 8.0, (1, 0, 0)),
    "blob": ("base", ("head",), 9.0, (1, 0, 0)),
    "character": ("feet", ("head", "left_hand", "right_hand"), 9.0, (0, 0, 1)),
}


def body(name: str, scale: float = 1.0) -> tuple[QuadraticMesh, dict]:
    """Return the mesh of a fixture, and the nodes of its regions."""
    device = load_device(DEVICES / name)
    linear_mesh = tetrahedralize(load_body(device.body).surface, scale * BODIES[name][2]).mesh
    mesh = QuadraticMesh.from_linear(conform_to_regions(linear_mesh, list(device.regions.values())))
    regions = {n: np.flatnonzero(s.contains(mesh.nodes)) for n, s in device.regions.items()}
    return mesh, regions


def material(nu: float, model: str = "neo-hookean") -> Material:
    """Return a material of a model, with E = 0.6 MPa."""
    mu, kappa = 0.6 / (2 * (1 + nu)), 0.6 / (3 * (1 - 2 * nu))
    if model == "stable-neo-hookean":
        return stable_neo_hookean(mu, kappa)
    if model == "mooney-rivlin":
        return split(kappa, 0.35 * mu, c01=0.15 * mu, model=model)
    if model == "yeoh":
        return split(kappa, 0.5 * mu, c20=-0.01 * mu, c30=0.002 * mu, model=model)
    return neo_hookean(mu, kappa)


def clamp(mesh, regions, fixed, moved, rotation, translation):
    """Return conditions that fix one region and move another."""
    handle_nodes = regions[moved]
    center = (mesh.nodes[handle_nodes].min(0) + mesh.nodes[handle_nodes].max(0)) / 2
    handle = RigidHandle(
        handle_nodes, center, np.array(rotation, float), np.array(translation, float)
    )
    return BoundaryConditions(regions[fixed], (handle,))


def verdict(mesh, conditions, law, result: Equilibrium) -> str:
    """Return a description of a result; it starts with WRONG if the status is too good."""
    if result.state is None:
        return f"{result.status}, {result.amplitude:.0%} of the amplitude reached"
    wrong = faults(
        mesh.nodes,
        mesh.cells,
        conditions,
        result.state,
        result.statistics.energy,
        law.model,
        law.parameters,
    )
    if wrong:
        return "WRONG: " + "; ".join(wrong)
    return str(result.status) + (f": {result.problem}" if result.problem else "")


def elsewhere(mesh, law, goal, result: Equilibrium) -> float:
    """Return the largest distance (mm) to the equilibrium that ten equal steps reach."""
    slow = solve_ramp(mesh, law, goal, np.arange(1, 11) / 10, threads=count_cores())[-1]
    return np.inf if slow.u is None else float(np.abs(slow.u - result.u).max())


def extremes(name: str, regions: dict, mesh: QuadraticMesh) -> dict[str, tuple]:
    """Return bend and twist by 180 degrees, and a pull to 150 % of the free length."""
    fixed, moved, _, axis = BODIES[name]
    axis = np.array(axis, float)
    across = np.roll(axis, 1)
    free = np.full(3, np.nan)
    x = mesh.nodes @ axis
    ends = x[regions[fixed]], x[regions[moved[0]]]
    length = ends[1].min() - ends[0].max()
    return {
        "bend 180": (moved[0], np.pi * across, free),
        "twist 180": (moved[0], np.pi * axis, free),
        "pull to 150 %": (moved[0], np.zeros(3), 0.5 * length * axis),
    }


def random_pose(rng: np.random.Generator, name: str) -> tuple[str, np.ndarray, np.ndarray]:
    """Return a region, a rotation of up to 120 degrees, and a translation: free, or up to 30 mm."""
    moved = rng.choice(BODIES[name][1])
    axis = rng.normal(size=3)
    rotation = axis / np.linalg.norm(axis) * np.deg2rad(rng.uniform(10, 120))
    translation = rng.uniform(-30, 30, 3)
    translation[rng.random(3) < 0.6] = np.nan
    return str(moved), rotation, translation


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--random", type=int, default=60, help="how many random poses")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only-random", action="store_true", help="leave the extremes out")
    parser.add_argument(
        "--slowly",
        action="store_true",
        help="solve what is ok again in ten steps, and tell where that ends elsewhere",
    )
    parser.add_argument("--edge", type=float, default=1.0, help="factor on the edge lengths")
    options = parser.parse_args()
    bodies = {name: body(name, options.edge) for name in BODIES}
    for name, (mesh, regions) in () if options.only_random else bodies.items():
        print(f"{name}: {len(mesh.cells)} quadratic tets")
        law = material(0.49)
        for title, (moved, rotation, translation) in extremes(name, regions, mesh).items():
            goal = clamp(mesh, regions, BODIES[name][0], moved, rotation, translation)
            start = time.perf_counter()
            result = solve_ramp(mesh, law, goal, [1.0], threads=count_cores())[-1]
            seconds = time.perf_counter() - start
            print(f"  {title}, nu 0.49: {verdict(mesh, goal, law, result)} ({seconds:.1f} s)")
    rng = np.random.default_rng(options.seed)
    counts: dict[str, int] = {}
    for k in range(options.random):
        name = list(BODIES)[k % len(BODIES)]
        mesh, regions = bodies[name]
        moved, rotation, translation = random_pose(rng, name)
        models = ("neo-hookean", "stable-neo-hookean", "mooney-rivlin", "yeoh")
        nu, model = float(rng.choice([0.45, 0.49])), str(rng.choice(models))
        law = material(nu, model)
        goal = clamp(mesh, regions, BODIES[name][0], moved, rotation, translation)
        result = solve_ramp(mesh, law, goal, [1.0], threads=count_cores())[-1]
        message = verdict(mesh, goal, law, result)
        kind = "WRONG" if message.startswith("WRONG") else Status(result.status).name
        if options.slowly and kind == "OK":
            distance = elsewhere(mesh, law, goal, result)
            if distance > 0.1:
                kind, message = "ELSEWHERE", f"{distance:.1f} mm from where ten steps lead"
        counts[kind] = counts.get(kind, 0) + 1
        if kind != "OK":
            degrees = ", ".join(f"{v:.0f}" for v in np.rad2deg(rotation))
            title_text = f"{name} {moved} ({degrees}) deg {np.round(translation, 0)} {model} {nu}"
            print(f"  {k}: {title_text}: {message}", flush=True)
        if (k + 1) % 5 == 0:
            print(f"  after {k + 1}: {counts}", flush=True)
    print(f"{options.random} random poses, seed {options.seed}: {counts}")


if __name__ == "__main__":
    main()
