"""Count successful builds, and measure how the designs vary: on other meshes, and of random bodies.

    python -m benchmarks.builds meshes fixtures/devices/bar fixtures/devices/blob --count 10
    python -m benchmarks.builds bodies --count 100 --seed 0

`meshes` builds each device with edges up to `--spread` longer and shorter than its own, without
cached meshes. `bodies` generates round, boxy and bent bodies of random size, with one to three
poses (bends, twists, pulls) and as many cords, or one less. Both build up to the parts, or to the
stage `--until`. A build that ends in an error message is `refused`. A build that fails otherwise is
`broken`, and so is a finished build with missing parts.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import trimesh

from defsense_fab.core.device.device import Device
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import DefsenseError
from defsense_fab.store.layout import load_layout
from defsense_fab.store.mesh import load_mesh_record
from defsense_fab.workflow.build.build import build


def outcome(make_device: Callable[[], Device], until: str) -> tuple[str, str, float]:
    """Return `made`, `refused` or `broken`, a description, and the RMSE (mm) on unseen states."""
    try:
        device = make_device()
        folder = build(device, until).folder
    except DefsenseError as error:
        return "refused", str(error), np.nan
    except Exception as error:
        return "broken", repr(error), np.nan
    layout = load_layout(folder)
    chosen = next(t for t in layout.weighed if t.chosen)
    text = (
        f"{layout.band.median:.3f} mm ({layout.band.low:.3f}-{layout.band.high:.3f}),"
        f" {layout.prediction.decoder}, {chosen.planes} planes, {chosen.slanted} slanted,"
        f" {chosen.parts} parts, {len(chosen.warnings)} notes"
    )
    if until in ("fabricate", "report"):
        manifest = json.loads((folder / "parts" / "manifest.json").read_text())
        kinds = ("stl", "print") if device.body.kind == "mesh" else ("stl", "print", "step")
        named = [p[kind] for p in manifest["parts"] for kind in kinds]
        gone = [n for n in named if n is None or not (folder / "parts" / n).exists()]
        if gone:
            return "broken", f"{text}; missing: {', '.join(map(str, gone))}", layout.band.median
    return "made", text, layout.band.median


def on_meshes(source: Path, options: argparse.Namespace) -> None:
    """Build one device on other meshes."""
    first = load_device(source)
    device_edge = first.mesh.edge_length
    if device_edge is None:
        device_edge = load_mesh_record(build(first, "mesh").folder).edge_length
    errors, kinds = [], []
    factors = np.linspace(1 - options.spread, 1 + options.spread, options.count)
    for k, factor in list(enumerate(factors))[options.first - 1 :]:
        with tempfile.TemporaryDirectory() as make_device:
            copy = Path(make_device) / source.name
            shutil.copytree(
                source, copy, ignore=shutil.ignore_patterns("build", ".build*", "*.mesh")
            )
            device = load_device(copy)
            mesh = replace(device.mesh, edge_length=float(device_edge * factor))
            kind, text, error = outcome(partial(replace, device, mesh=mesh), options.until)
        kinds.append(kind)
        errors.append(error)
        print(
            f"  {source.name} {k + 1}, edge {device_edge * factor:.2f} mm: {kind}: {text}",
            flush=True,
        )
    finite_errors = np.array(errors)[np.isfinite(errors)]
    spread = (
        f"{finite_errors.min():.3f} to {finite_errors.max():.3f} mm"
        if len(finite_errors)
        else "no error"
    )
    print(f"{source.name}: {_counted(kinds)}; {spread}", flush=True)


def random_body(rng: np.random.Generator) -> trimesh.Trimesh:
    """Return a round or boxy body, 70 to 180 mm long, with random swellings, bend and taper."""
    long, wide, high = rng.uniform([70, 28, 26], [180, 60, 50])
    ball = trimesh.creation.icosphere(subdivisions=4)
    round_off = rng.uniform(2, 6)  # of the norm whose unit ball is taken: 2 is a ball
    norm = np.linalg.norm(ball.vertices, round_off, axis=1)
    x, y, z = (ball.vertices / norm[:, None]).T
    girth = 1 + rng.uniform(-0.3, 0.3) * x
    for n in (1, 2, 3):
        girth += rng.normal(0, 0.12 / n) * np.sin(n * np.pi * x + rng.uniform(0, 2 * np.pi))
    girth = np.maximum(girth, 0.6)
    bend = rng.uniform(-0.25, 0.25, 2) * high
    ball.vertices = np.stack(
        [
            long / 2 * x,
            wide / 2 * y * girth + bend[0] * x**2,
            high / 2 * z * girth + bend[1] * x**2,
        ],
        axis=1,
    )
    return ball


def write_random(folder: Path, rng: np.random.Generator) -> None:
    """Write a device with a random body and random poses."""
    body = random_body(rng)
    body.export(folder / "body.stl")
    low, high = body.bounds[:, 0]
    ends = low + 0.12 * (high - low), high - 0.12 * (high - low)
    kinds = {
        "bend_up": f"rotate = {{ axis = [0, 1, 0], degrees = {rng.uniform(-45, -20):.1f} }}",
        "bend_side": f"rotate = {{ axis = [0, 0, 1], degrees = {rng.uniform(20, 45):.1f} }}",
        "twist": f"rotate = {{ axis = [1, 0, 0], degrees = {rng.uniform(20, 60):.1f} }}",
        "pull": f"translate = [{rng.uniform(0.05, 0.12) * (high - low):.1f}, 0, 0]",
    }
    chosen = rng.permutation(list(kinds))[: rng.integers(1, 4)]
    cords = max(1, len(chosen) - int(rng.random() < 0.4))
    poses = "".join(
        f'[[poses]]\nname = "{name}"\nfixed = ["base"]\n[[poses.handles]]\nregion = "tip"\n'
        f"{kinds[name]}\n" + ('translate = "free"\n' if name != "pull" else "") + "\n"
        for name in chosen
    )
    material = rng.choice(["ninjaflex-85a", "filaflex-70a"])
    (folder / "device.toml").write_text(
        f"""schema = 1
name = "{folder.name}"
[body]
mesh = "body.stl"
[material]
name = "{material}"
[mesh]
edge_length = {rng.uniform(7, 9):.1f}
[regions]
base = {{ half_space = {{ origin = [{ends[0]:.1f}, 0, 0], normal = [-1, 0, 0] }} }}
tip = {{ half_space = {{ origin = [{ends[1]:.1f}, 0, 0], normal = [1, 0, 0] }} }}
{poses}
[outputs]
markers = 30
anchor = "base"
[cord]
name = "rubber-2mm"
[design]
sensors = {cords}
"""
    )


def of_bodies(options: argparse.Namespace) -> None:
    """Build random bodies."""
    kinds = []
    streams = np.random.default_rng(options.seed).spawn(options.count)
    for k, rng in list(enumerate(streams, 1))[options.first - 1 :]:
        with tempfile.TemporaryDirectory() as make_device:
            folder = Path(make_device) / f"body-{k}"
            folder.mkdir()
            write_random(folder, rng)
            kind, text, _ = outcome(partial(load_device, folder), options.until)
        kinds.append(kind)
        print(f"  body {k}: {kind}: {text}", flush=True)
    print(
        f"random bodies {options.first} to {options.count}, seed {options.seed}: {_counted(kinds)}",
        flush=True,
    )


def _counted(kinds: list[str]) -> str:
    return ", ".join(f"{kinds.count(k)} {k}" for k in ("made", "refused", "broken"))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("meshes", "bodies"))
    parser.add_argument("folder", nargs="*", type=Path)
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--first", type=int, default=1, help="where to go on, counted from 1")
    parser.add_argument("--spread", type=float, default=0.05, help="of the edges' length")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--until", choices=("optimize", "fabricate", "report"), default="fabricate")
    options = parser.parse_args()
    if not 1 <= options.first <= options.count:
        parser.error(f"--first {options.first}: give a number from 1 to --count")
    if options.what == "bodies":
        of_bodies(options)
    for source in options.folder:
        on_meshes(source, options)


if __name__ == "__main__":
    main()
