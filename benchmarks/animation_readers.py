"""Recorded animations read back by other programs: the largest error of a vertex's position.

    python -m benchmarks.animation_readers write FOLDER --vertices 1000 --seconds 60
    python benchmarks/animation_readers.py read FOLDER/bar.glb FOLDER/bar.npz

`write` makes the bar of the tests bend, twist and stretch at 30 Hz, and says how long each format
takes and how large it gets. `read` is for an interpreter that has a reader: Blender (`pip install
bpy`; NumPy comes with it) for .glb and .usd*, else `pxr` (usd-core) for .usd*. It compares with the
numbers of the .npz at every recorded time and halfway between two, there with the straight line
that an Animation says, and prints the largest distance, mm.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

FPS = 30


def write(folder: Path, vertices: int, seconds: float) -> None:
    from defsense_fab.runtime.recording.animation_recorder import AnimationRecorder
    from tests.runtime.recording_bars import bar, frames

    folder.mkdir(parents=True, exist_ok=True)
    rest, faces = bar(along=vertices // 20, around=20)
    for suffix in (".glb", ".usdc", ".npz"):
        with AnimationRecorder(folder / f"bar{suffix}", rest, faces, fps=FPS) as recorder:
            spent = 0.0
            for count, frame in enumerate(frames(seconds, 100, rest), 1):  # noqa: B007
                begun = time.perf_counter()
                recorder.add(frame)
                spent += time.perf_counter() - begun
            begun = time.perf_counter()
            done = recorder.finish()
        print(
            f"{done.path.name}: {len(rest)} vertices, {done.frames} frames, {done.size / 1e6:.2f}"
            f" MB, written in {time.perf_counter() - begun:.2f} s, {done.targets} targets, error"
            f" {done.error:.4f} mm; adding a frame took {1e3 * spent / count:.3f} ms"
        )


def blender(path: Path) -> Callable[[float], Any]:
    """Vertices (v, 3) mm in Blender's world at a time (s)."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = FPS
    if path.suffix == ".glb":
        bpy.ops.import_scene.gltf(filepath=str(path))
    else:
        bpy.ops.wm.usd_import(filepath=str(path))
    (surface,) = [o for o in bpy.data.objects if o.type == "MESH"]
    print(f"Blender {bpy.app.version_string}: {surface.name}, scale {tuple(surface.scale)}")

    def vertices(at: float) -> Any:
        whole, part = divmod(at * scene.render.fps, 1)
        scene.frame_set(int(whole), subframe=part)
        shown = surface.evaluated_get(bpy.context.evaluated_depsgraph_get())
        mesh = shown.to_mesh()
        local = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", local)
        world = np.array(shown.matrix_world)
        metres = scene.unit_settings.scale_length
        return 1000 * metres * (local.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3])

    return vertices


def usd(path: Path) -> Callable[[float], Any]:
    """Vertices (v, 3) mm at a time (s)."""
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    (mesh,) = [UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)]
    scale = 1000 * UsdGeom.GetStageMetersPerUnit(stage)
    print(f"USD {Usd.GetVersion()}: up {UsdGeom.GetStageUpAxis(stage)}, {scale:g} mm per unit")

    def vertices(at: float) -> Any:
        code = Usd.TimeCode(at * stage.GetTimeCodesPerSecond())
        return scale * np.array(mesh.GetPointsAttr().Get(code), float)

    return vertices


def read(path: Path, truth: Path) -> None:
    try:
        vertices = blender(path)
    except ImportError:
        if path.suffix == ".glb":
            sys.exit("reading .glb needs bpy: pip install bpy")
        vertices = usd(path)
    data = np.load(truth)
    times, positions, rest = data["times"], data["positions"].astype(float), data["rest"]
    largest, between = 0.0, 0.0
    for k, at in enumerate(times):
        largest = max(largest, np.linalg.norm(vertices(at) - positions[k], axis=1).max())
    for k in range(0, len(times) - 1, 10):
        expected = (positions[k] + positions[k + 1]) / 2
        found = vertices((times[k] + times[k + 1]) / 2)
        between = max(between, np.linalg.norm(found - expected, axis=1).max())
    moved = np.linalg.norm(positions - rest, axis=2).max()
    print(
        f"{path.name}: largest error {largest:.4f} mm at {len(times)} frames,"
        f" {between:.4f} mm between them, of {moved:.0f} mm of motion"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    tasks = parser.add_subparsers(dest="task", required=True)
    task = tasks.add_parser("write")
    task.add_argument("folder", type=Path)
    task.add_argument("--vertices", type=int, default=1000)
    task.add_argument("--seconds", type=float, default=60)
    task = tasks.add_parser("read")
    task.add_argument("file", type=Path)
    task.add_argument("truth", type=Path)
    asked = parser.parse_args()
    if asked.task == "write":
        write(asked.folder, asked.vertices, asked.seconds)
    else:
        read(asked.file, asked.truth)


if __name__ == "__main__":
    main()
