"""Measure meshes, poses and states of random animals, in CPU seconds.

    python -m benchmarks.organic 1 2 3 4 5             # seeds
    python -m benchmarks.organic 6 --until report      # the whole build
    python -m benchmarks.organic 7 --triangles 100000

Each animal (`organic_bodies.animal`) of 150 mm is meshed with edges of 8 mm, in silicone, held by
its feet (odd seeds) or its rear end (even seeds). `defsense modes` proposes its poses, and two
cords are designed. Every seed runs in a separate process with an empty cache.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from .bodies import memory
from .organic_bodies import animal, write_stl
from .stages import cpu

EDGE_MM = 8.0


def write_device(folder: Path, seed: int, triangles: int | None) -> int:
    """Write the device of an animal without poses; return its number of triangles."""
    surface = animal(seed, triangles)
    write_stl(surface, folder / "body.stl")
    low, high = surface.bounds
    axis = 2 if seed % 2 else 0
    origin, normal = [0.0, 0.0, 0.0], [0, 0, 0]
    origin[axis], normal[axis] = float(low[axis] + 0.12 * (high - low)[axis]), -1
    (folder / "device.toml").write_text(
        f'schema = 1\nname = "animal {seed}"\n\n[body]\nmesh = "body.stl"\n\n[material]\n'
        f'name = "ninjaflex-85a"\n\n[mesh]\nedge_length = {EDGE_MM}\n\n[regions]\n'
        f"base = {{ half_space = {{ origin = {origin}, normal = {normal} }} }}\n\n[outputs]\n"
        'markers = 30\nanchor = "base"\n\n[cord]\nname = "rubber-2mm"\nnoise = 0.002\n\n'
        '[fabrication]\nprocess = "fdm-tpu"\n\n[design]\nsensors = 2\n'
    )
    return len(surface.faces)


def measured(folder: Path, until: str) -> dict[str, Any]:
    """Propose poses and build the device in `folder`; return the measurements."""
    from defsense_fab.core.device.device_file import load_device
    from defsense_fab.geometry.bodies.meshing.mesh_quality import bound_ratio, dihedral_angles
    from defsense_fab.store.mesh import load_mesh
    from defsense_fab.workflow.build.build import build
    from defsense_fab.workflow.study.options import ModesOptions
    from defsense_fab.workflow.study.propose_poses import append_poses, propose_poses

    started_at = cpu()
    device = load_device(folder, complete=False)
    out: dict[str, Any] = {"stages": {"read": cpu() - started_at}}
    marks: list[tuple[str, float]] = [("modes", cpu())]

    def progress(stage: str, _: float, __: str) -> None:
        if stage != marks[-1][0]:
            marks.append((stage, cpu()))
            print(f"    {stage}", file=sys.stderr, flush=True)

    try:
        proposal = propose_poses(device, ModesOptions("base"), progress)
        out["poses"] = [p.name for p in proposal.poses]
        append_poses(folder / "device.toml", proposal, ())
        result = build(load_device(folder), until, progress).folder
    except Exception as error:  # what a user would see, or a fault of this project
        out["error"] = f"{type(error).__name__}: {error}"
        result = folder / "build"
    marks.append(("", cpu()))
    for (name, start), (_, end) in pairwise(marks):
        out["stages"][name] = out["stages"].get(name, 0.0) + end - start
    if (result / "mesh.json").exists():
        record, mesh = json.loads((result / "mesh.json").read_text()), load_mesh(result)
        angles = np.rad2deg(dihedral_angles(mesh))
        out |= {k: record[k] for k in ("tets", "way", "tried", "volume_change")}
        out |= {"deviation": record["boundary_deviation"], "least": float(angles.min())}
        out |= {"percentile": float(np.percentile(angles, 1)), "bounds": bound_ratio(mesh)}
    if (result / "fields" / "index.json").exists():
        out["index"] = json.loads((result / "fields" / "index.json").read_text())
    return out | {"memory": memory()}


def format_lines(seed: int, result: dict[str, Any]) -> str:
    """Return the lines of the table for one animal."""
    stages = ", ".join(f"{k} {v:.1f}" for k, v in result["stages"].items())
    lines = [
        f"{seed}: {result['triangles']:,} triangles, {sum(result['stages'].values()):.1f} CPU s"
        f" ({stages}), {result['memory']:.2f} GB"
    ]
    if "tets" in result:
        lines.append(
            f"    {result['way']}: {result['tets']} tets, dihedral angles: first percentile"
            f" {result['percentile']:.1f}, least {result['least']:.1f} ({result['bounds']:.2f} of"
            f" the bounds), {result['deviation']:.2f} mm off, volume"
            f" {100 * result['volume_change']:+.2f} %"
        )
    if "index" in result:
        states = result["index"]["states"]
        per_state = result["stages"].get("simulate", 0.0) / max(len(states), 1)
        lines.append(
            f"    {len(states)} states of {', '.join(result['poses'])}: {per_state:.2f} CPU s each,"
            f" {np.median([s['factors'] for s in states]):.0f} matrices (largest"
            f" {max(s['factors'] for s in states)})"
        )
        lines += [f"    warning: {w}" for w in result["index"]["warnings"]]
    lines += [f"    {result['error']}"] if "error" in result else []
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("seeds", nargs="+", type=int)
    parser.add_argument("--triangles", type=int, help="of each animal; by default as drawn")
    parser.add_argument("--until", default="simulate")
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(measured(options.one, options.until)))
        return
    for seed in options.seeds:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary) / "device"
            folder.mkdir()
            triangles = write_device(folder, seed, options.triangles)
            output = subprocess.run(
                [sys.executable, "-m", "benchmarks.organic", str(seed), "--until", options.until,
                 "--one", str(folder)],
                env=os.environ | {"DEFSENSE_CACHE": str(Path(temporary) / "cache")},
                stdout=subprocess.PIPE, text=True, check=True,
            ).stdout  # fmt: skip
        result = json.loads(output.splitlines()[-1]) | {"triangles": triangles}
        print(format_lines(seed, result), flush=True)


if __name__ == "__main__":
    main()
