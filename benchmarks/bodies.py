"""Measure the way from bodies to parts, next to Netgen and fTetWild alone.

    python -m benchmarks.bodies                       # all bodies
    python -m benchmarks.bodies armadillo flat --limit 300
    python -m benchmarks.bodies --file bunny.obj --scale 1500 --until mesh
    python -m benchmarks.bodies --defective           # those of tests.support.defective_bodies

Each body is read, meshed and built up to the parts with a standard device: two bends of its ends
along its longest axis, and two cords. A separate process with a time limit and an empty cache of
meshes does so. Both meshers get the surface as it was read and the same edge length, each in a
separate process. Times are CPU seconds with those of child processes; memory is that of the largest
process. If PrusaSlicer (`prusa-slicer`) is installed, it slices the first part.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from defsense_fab.core.mesh import Surface

from .organic_bodies import BODIES, write_stl
from .stages import cpu

# The standard device of a body: two bends of its ends along its longest axis, two cords.

#: Of the body's length, what an end holds; about how many tets it has; their edges, mm.
_END, _TETS, _EDGES = 0.1, 5000, (3.0, 12.0)


def write_device(folder: Path, body: Path, surface: Surface, scale: float = 1.0) -> None:
    """Write `device.toml` for the file `body` in `folder`, whose scaled surface (mm) is given."""
    low, high = surface.bounds
    along = int((high - low).argmax())
    size = float((high - low).max())
    edge = float(np.clip(np.cbrt(8.5 * surface.volume / _TETS), *_EDGES))
    axes = [k for k in range(3) if k != along]
    text = [
        f'schema = 1\nname = "{folder.name}"\n\n[body]\nmesh = "{body.name}"\nscale = {scale}\n',
        '[material]\nname = "ninjaflex-85a"\n',
        f"[mesh]\nedge_length = {edge:.3g}\n\n[regions]",
    ]
    for name, at, sign in (("base", low, -1), ("tip", high, 1)):
        origin, normal = [0.0, 0.0, 0.0], [0, 0, 0]
        origin[along] = float(at[along] - sign * _END * size)
        normal[along] = sign
        text.append(f"{name} = {{ half_space = {{ origin = {origin}, normal = {normal} }} }}")
    for name, k in zip(("nod", "sway"), axes, strict=True):
        axis = [int(i == k) for i in range(3)]
        text.append(
            f'\n[[poses]]\nname = "{name}"\nfixed = ["base"]\n[[poses.handles]]\nregion = "tip"\n'
            f'rotate = {{ axis = {axis}, degrees = 25 }}\ntranslate = "free"'
        )
    text.append(
        '\n[outputs]\nmarkers = 30\nanchor = "base"\n\n[cord]\nname = "rubber-2mm"\nnoise = 0.002\n'
        '\n[fabrication]\nprocess = "fdm-tpu"\n\n[design]\nsensors = 2\n'
    )
    (folder / "device.toml").write_text("\n".join(text))


ALONE = ("netgen", "ftetwild")


def memory() -> float:
    """Return the peak memory of this process or of its largest child, GB."""
    used = [resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return max(u.ru_maxrss for u in used) / 1e6


def built(folder: Path, until: str, scale: float) -> dict[str, Any]:
    """Read, mesh and build the body in `folder`; return the measurements."""
    from defsense_fab.core.device.device_file import load_device
    from defsense_fab.geometry.bodies.body import SIZE_RANGE_MM
    from defsense_fab.geometry.bodies.mesh_files import read_mesh
    from defsense_fab.workflow.build.build import build

    started_at = cpu()
    (file,) = folder.glob("body.*")
    surface, repairs, _ = read_mesh(file, scale, SIZE_RANGE_MM)
    out: dict[str, Any] = {"triangles": len(surface.faces), "repairs": list(repairs)}
    out["read"] = cpu() - started_at
    write_device(folder, file, surface, scale)
    device = load_device(folder)
    marks: dict[str, float] = {}
    started_at = cpu()

    def progress(stage: str, fraction: float, message: str) -> None:
        marks[stage] = cpu()
        if fraction == 0.0:
            print(f"    {stage}", file=sys.stderr, flush=True)

    def measurements() -> dict[str, Any]:
        ends = [started_at, *marks.values()]
        took = dict(zip(marks, np.diff(ends).tolist(), strict=True))
        return out | {"stages": took, "whole": cpu() - started_at, "memory": memory()}

    try:
        where = build(device, until, progress).folder
    except Exception as error:  # what a user would see, or a fault of this project
        return measurements() | {"error": f"{type(error).__name__}: {error}"}
    record = json.loads((where / "mesh.json").read_text())
    keys = ("tets", "min_dihedral", "boundary_deviation", "volume_change", "way", "tried")
    out |= {key: record[key] for key in keys} | {"edge_length": record["edge_length"]}
    return measurements()


def alone(folder: Path, mesher: str, scale: float) -> dict[str, Any]:
    """Mesh the surface as it was read by one mesher alone; return the measurements."""
    from defsense_fab.core.device.device_file import load_device
    from defsense_fab.geometry.bodies.body import SIZE_RANGE_MM
    from defsense_fab.geometry.bodies.mesh_files import read_mesh
    from defsense_fab.geometry.bodies.meshing.child_work import RunMonitor
    from defsense_fab.geometry.bodies.meshing.mesh_quality import measure_quality
    from defsense_fab.geometry.bodies.meshing.meshers import run_mesher

    (file,) = folder.glob("body.*")
    surface, _, _ = read_mesh(file, scale, SIZE_RANGE_MM)
    edge = load_device(folder).mesh.edge_length
    size = float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    more: dict[str, Any] = {"grading": 0.3, "points": np.zeros((0, 3)), "edges": []}
    if mesher == "ftetwild":
        more = {"epsilon": min(1e-3, 0.02 * edge / size)}
    started_at = cpu()
    watch = RunMonitor(1e9, lambda _: None, mesher, 1.0, "nothing")
    try:
        mesh = run_mesher(mesher, surface, {"edge_length": edge} | more, watch)
    except Exception as error:
        return {"error": str(error).partition(";")[0], "whole": cpu() - started_at}
    result = measure_quality(mesh, surface)
    return {
        "whole": cpu() - started_at,
        "tets": result.tets,
        "min_dihedral": result.min_dihedral,
        "volume_change": result.volume_change,
        "memory": memory(),
    }


def in_process(arguments: list[str], folder: Path, limit: float) -> dict[str, Any]:
    """Run a measurement in a new process, which is killed after `limit` s."""
    environment = os.environ | {"DEFSENSE_CACHE": str(folder / "meshes"), "OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.bodies", *arguments, "--one", str(folder)],
        env=environment, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        output, _ = process.communicate(timeout=limit)
        return dict(json.loads(output.splitlines()[-1]))
    except subprocess.TimeoutExpired:
        process.kill()  # its children end with it
        process.communicate()
        return {"error": f"not done within {limit:g} s"}
    except (IndexError, ValueError):
        return {"error": f"ended with exit code {process.returncode}"}


def sliced(folder: Path) -> str:
    """Return how PrusaSlicer slices the first part, or why it does not."""
    program = shutil.which("prusa-slicer")
    parts = sorted((folder / "build" / "parts" / "print").glob("*.stl"))
    if program is None or not parts:
        return "no slicer" if program is None else "no parts"
    target = folder / "part.gcode"
    process_result = subprocess.run(
        [program, "--export-gcode", "--output", str(target), str(parts[0])],
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    bad = [
        s
        for s in (process_result.stdout + process_result.stderr).splitlines()
        if "error" in s.lower()
    ]
    if process_result.returncode or bad or not target.exists():
        return f"refused: {(bad or [process_result.stderr.strip()])[-1][:80]}"
    layers = target.read_text(errors="replace").count(";LAYER_CHANGE")
    return f"sliced, {layers} layers"


def format_lines(
    name: str, ours: dict[str, Any], others: dict[str, dict[str, Any]], slicer: str
) -> str:
    """Return the lines of the table for one body."""
    head = f"{name}: {ours.get('triangles', 0):,} triangles, read {ours.get('read', 0):.1f} s"
    if "whole" in ours:
        stages = ", ".join(f"{k} {v:.1f}" for k, v in ours["stages"].items())
        head += f", whole {ours['whole']:.1f} s ({stages}), {ours['memory']:.2f} GB"
    lines = [head]
    if "tets" in ours:
        lines.append(
            f"    {ours['way']}, edges {ours['edge_length']:.1f} mm: {ours['tets']} tets, least"
            f" angle {ours['min_dihedral']:.1f}, {ours['boundary_deviation']:.2f} mm off, volume"
            f" {100 * ours['volume_change']:+.2f} %; {slicer}"
        )
        lines += [f"    before: {t}" for t in ours["tried"]]
    if "error" in ours:
        lines.append(f"    REFUSED: {ours['error']}")
    for mesher, result in others.items():
        text = result.get("error") or (
            f"{result['tets']} tets, least angle {result['min_dihedral']:.2f}, volume"
            f" {100 * result['volume_change']:+.2f} %, {result['memory']:.2f} GB"
        )
        lines.append(f"    {mesher} alone: {result.get('whole', float('nan')):.1f} s, {text}")
    return "\n".join(lines)


def defective() -> dict[str, Callable[[Path], None]]:
    """Return functions that write the bodies of `tests.support.defective_bodies`, by name."""

    def write(path: Path, make: Callable[[int, int], Any]) -> None:
        temporary = make(4, 0)
        write_stl(Surface(temporary.vertices, temporary.faces), path)

    makers = import_module("tests.support.defective_bodies").BODIES
    return {name: partial(write, make=make) for name, make in makers.items()}


def sources(options: argparse.Namespace) -> dict[str, Callable[[Path], Path]]:
    """Return functions that write each body into a folder and return its file, by name."""
    out: dict[str, Callable[[Path], Path]] = {}
    for path in options.file:
        out[path.stem] = lambda f, p=path: Path(shutil.copy(p, f / f"body{p.suffix}"))
    if options.defective:
        for name, write in defective().items():
            out[name] = lambda f, w=write: (w(f / "body.stl"), f / "body.stl")[1]
    for name, make in BODIES.items() if not out else ():
        if not options.bodies or name in options.bodies:
            out[name] = lambda f, m=make: (write_stl(m(), f / "body.stl"), f / "body.stl")[1]
    return out


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bodies", nargs="*", help=f"of {', '.join(BODIES)}")
    parser.add_argument("--file", type=Path, nargs="+", default=[], help="bodies of your own")
    parser.add_argument("--scale", type=float, default=1.0, help="of those, to mm")
    parser.add_argument("--defective", action="store_true")
    parser.add_argument("--until", default="fabricate")
    parser.add_argument("--limit", type=float, default=900.0, help="s, of each process")
    parser.add_argument("--ours", action="store_true", help="without the meshers alone")
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--mesher", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        body_name = options.one
        result = (
            alone(body_name, options.mesher, options.scale)
            if options.mesher
            else built(body_name, options.until, options.scale)
        )
        print(json.dumps(result))
        return
    same = ["--until", options.until, "--scale", str(options.scale)]
    for name, write in sources(options).items():
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary) / "device"
            folder.mkdir()
            write(folder)
            ours = in_process(same, folder, options.limit)
            others = {}
            if not options.ours and (folder / "device.toml").exists():
                for mesher in ALONE:
                    others[mesher] = in_process([*same, "--mesher", mesher], folder, options.limit)
            print(format_lines(name, ours, others, sliced(folder)), flush=True)


if __name__ == "__main__":
    main()
