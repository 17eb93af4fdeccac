"""Time and memory of making parts: a table of devices, and the groove step against build123d.

    python -m benchmarks.fabrication table      # bar, cube, blob, character with 54,000 triangles
    python -m benchmarks.fabrication groove     # one groove and one cut: manifold3d, build123d

Every row runs in a process of its own, so that its peak of memory is its own; imports and loading
of the body are not counted in the seconds, but the memory holds them. Layouts are seeded ones of
`tests/geometry/parts/random_layouts.py`, but for bar and cube, whose cords are drawn.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

DEVICES = Path(__file__).parents[1] / "fixtures" / "devices"
#: Device, seed of its layout (None: as drawn), size of the cells that its mesh is made from.
TABLE = (("bar", None, None), ("cube", None, None), ("blob", 16, None), ("character", 3, None),
         ("character", 3, 1.15))  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("table", "groove", "one"), nargs="?", default="table")
    parser.add_argument("--task", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.what == "one":
        print(json.dumps(one(**json.loads(options.task))))
    elif options.what == "table":
        table()
    else:
        groove()


def alone(**task: object) -> dict:
    """`one` in a fresh process."""
    command = [sys.executable, "-m", "benchmarks.fabrication", "one", "--task", json.dumps(task)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        return {"error": done.stderr.strip().splitlines()[-1]}
    return json.loads(done.stdout.splitlines()[-1])


def one(kind: str, name: str, seed: int | None = None, cell: float | None = None) -> dict:
    body, device = load(name, cell)
    base = peak()
    begin = time.perf_counter()
    if kind == "parts":
        found = parts(device, body, seed)
    else:
        found = {"manifold3d": by_manifold, "build123d": by_build123d}[kind](body, device)
    return {**found, "faces": len(body.surface.faces), "memory": peak(), "before": base} | {
        "seconds": found.get("seconds", time.perf_counter() - begin)
    }


def load(name: str, cell: float | None):
    from defsense_fab.core.device.device_file import load_device
    from defsense_fab.core.mesh import Surface
    from defsense_fab.geometry.bodies.body import Body, load_body

    device = load_device(DEVICES / name)
    if cell is None:
        return load_body(device.body), device
    sys.path.insert(0, str(DEVICES / name))
    import make_character

    make_character.CELL = cell
    vertices, faces = make_character.character()
    surface = Surface(np.asarray(vertices, float), np.asarray(faces, np.int64))
    if surface.volume < 0:
        surface = Surface(surface.vertices, surface.faces[:, ::-1].copy())
    return Body(surface, surface.volume), device


def parts(device, body, seed: int | None) -> dict:
    from defsense_fab.optimize.prediction.as_built import fabricate
    from defsense_fab.optimize.prediction.design_task import layout_limits
    from tests.geometry.parts.random_layouts import random_layout

    coarse = load(device.name, None)[0].surface
    sensors = device.sensors if seed is None else random_layout(coarse, layout_limits(device), seed)
    begin = time.perf_counter()
    made = fabricate(device, body.surface, sensors, lambda *_: None, body.solid)
    step = all(p.solid is not None for p in made.parts)
    return {"seconds": time.perf_counter() - begin, "cords": len(sensors),
            "parts": len(made.parts), "pins": len(made.pins), "step": step}  # fmt: skip


def straight(body):
    """A plane through the middle and a wavy path along the body's longest axis."""
    from defsense_fab.core.curve import Hermite, Plane, catmull_rom

    low, high = body.surface.bounds
    axis = int(np.ptp(body.surface.bounds, axis=0).argmax())
    x = np.eye(3)[axis]
    plane = Plane.from_normal((low + high) / 2, np.eye(3)[(axis + 1) % 3], x)
    half = float(high[axis] - low[axis]) / 2 + 5
    t = np.linspace(-1, 1, 9)
    points = np.stack([half * t, 2 * np.sin(3 * t)], axis=1)
    return plane, Hermite(points, catmull_rom(points))


def by_manifold(body, device) -> dict:
    from defsense_fab.geometry.kernels import triangle_kernel

    plane, curve = straight(body)
    begin = time.perf_counter()
    solid = triangle_kernel.to_manifold(body.surface, "body")
    path = plane.to_world(curve.sample(24))
    solid = solid - triangle_kernel.tube(path, plane.normal, device.channel_diameter)
    halves = solid.split_by_plane(plane.normal, float(plane.normal @ plane.origin))
    volumes = [h.volume() for h in halves]
    return {"seconds": time.perf_counter() - begin, "volume": sum(volumes)}


def by_build123d(body, device) -> dict:
    import build123d as bd

    from defsense_fab.core.curve_conversion import curve_to_arcs
    from defsense_fab.geometry.kernels import occ
    from defsense_fab.geometry.printing.export import write_stl

    plane, curve = straight(body)
    with tempfile.TemporaryDirectory() as folder:
        write_stl(body.surface, Path(folder) / "body.stl")
        begin = time.perf_counter()
        solid = bd.Mesher().read(str(Path(folder) / "body.stl"))[0]
    read = time.perf_counter() - begin
    pieces, ends = curve_to_arcs(curve, occ.PATH_TOLERANCE_MM), curve.tangents[[0, -1]]
    solid = solid - bd.Solid(occ.tube(plane, pieces, ends, 0.0, 0.0, device.channel_diameter))
    knife = bd.Plane(origin=tuple(plane.origin), x_dir=tuple(plane.axes[:, 0]),
                     z_dir=tuple(plane.normal))  # fmt: skip
    halves = bd.split(solid, bisect_by=knife, keep=bd.Keep.BOTH)
    volume = sum(s.volume for s in halves.solids())
    return {"seconds": time.perf_counter() - begin, "reading": read, "volume": volume}


def peak() -> float:
    """MB"""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def table() -> None:
    print(
        f"{'device':<12}{'triangles':>10}{'cords':>7}{'parts':>7}{'pins':>6}{'STEP':>6}{'s':>8}{'MB':>7}"
    )
    for name, seed, cell in TABLE:
        r = alone(kind="parts", name=name, seed=seed, cell=cell)
        if "error" in r:
            print(f"{name:<12}{r['error']}")
            continue
        print(
            f"{name:<12}{r['faces']:>10}{r['cords']:>7}{r['parts']:>7}{r['pins']:>6}"
            f"{'yes' if r['step'] else 'no':>6}{r['seconds']:>8.1f}{r['memory']:>7.0f}"
        )


def groove() -> None:
    for name in ("blob", "character"):
        ours, theirs = (alone(kind=k, name=name) for k in ("manifold3d", "build123d"))
        if "error" in theirs:
            print(f"{name}: build123d: {theirs['error']}")
            continue
        a, b = (max(r["memory"] - r["before"], 1.0) for r in (ours, theirs))
        differ = abs(theirs["volume"] / ours["volume"] - 1)
        print(
            f"{name}, {ours['faces']} triangles: manifold3d {ours['seconds']:.2f} s, {a:.0f} MB"
            f" more; build123d {theirs['seconds']:.1f} s (reading {theirs['reading']:.1f}),"
            f" {b:.0f} MB more: {theirs['seconds'] / ours['seconds']:.0f} times the time,"
            f" {b / a:.0f} times the memory; volumes differ by {differ:.1e}"
        )


if __name__ == "__main__":
    main()
