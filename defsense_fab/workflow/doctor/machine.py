"""Checks of the machine: processor, memory, disk, graphics, kernels, slicers and outputs."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path

from .checks import GRAPHICS, Finding, call, system_command

_GB = 1e9
MIN_DISK_GB, MIN_MEMORY_GB = 1.0, 2.0
#: Names of each slicer on PATH; on macOS it is also found among the applications.
_SLICERS = {
    "PrusaSlicer": ("prusa-slicer", "PrusaSlicer", "prusa-slicer-console"),
    "OrcaSlicer": ("orca-slicer", "OrcaSlicer"),
    "Cura": ("cura", "UltiMaker-Cura", "UltiMaker-Cura.AppImage", "CuraEngine"),
}
PRINTING_USE, CACHE_USE = "printing the parts here", "meshing a body only once"
BOX_VOLUME_MM3, MAX_VOLUME_ERROR_MM3 = 4000, 1e-2
MAX_RESIDUAL = 1e-8  # of the solved equations


def check_machine(seconds: float) -> list[Finding]:
    """Check memory, disk, and the cache of meshes."""
    return [*_check_memory(), _check_disk(), check_cache(seconds)]


def _check_memory() -> list[Finding]:
    """Check the memory, on systems that report it."""
    if sys.platform == "win32":
        return []
    size = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / _GB
    message = f"{size:.1f} GB ({MIN_MEMORY_GB:g} GB are required)"
    return [Finding("machine", "memory", size >= MIN_MEMORY_GB, message)]


def _check_disk() -> Finding:
    free = shutil.disk_usage(Path.cwd()).free / _GB
    message = f"{free:.1f} GB free in {Path.cwd()} ({MIN_DISK_GB:g} GB are required)"
    return Finding("machine", "disk", free >= MIN_DISK_GB, message)


def check_cache(seconds: float) -> Finding:
    """Check the cache of meshes. A cache that cannot be written costs time but stops no build."""
    answer = call(__name__, "cache_folder", seconds=seconds)
    if answer.failure:
        return Finding("machine", "cache", False, answer.failure, needed_for=CACHE_USE)
    folder = Path(answer.value)
    try:
        existing = next(p for p in (folder, *folder.parents) if p.exists())
        with tempfile.TemporaryFile(dir=existing):
            pass
        size = sum(p.stat().st_size for p in folder.glob("*.npz")) / _GB
    except OSError as error:
        command = "set" if os.name == "nt" else "export"
        return Finding(
            "machine",
            "cache",
            False,
            f"{folder}: {error.strerror}; set DEFSENSE_CACHE to a folder that can be written",
            f"{command} DEFSENSE_CACHE={Path(tempfile.gettempdir()) / 'defsense-cache'}",
            CACHE_USE,
        )
    message = f"{folder} ({size:.2f} GB)"
    return Finding("machine", "cache", True, message, needed_for=CACHE_USE)


def cache_folder() -> str:
    """Return the folder in which meshes are kept."""
    from ...geometry.bodies.meshing import mesh_store

    return str(mesh_store.cache_folder().resolve())


def check_graphics(seconds: float) -> Finding:
    """Check that OpenGL renders without a screen."""
    answer = call(__name__, "render_sphere", seconds=seconds)
    # A missing module is reported with the libraries.
    is_absent = answer.failure.startswith(ModuleNotFoundError.__name__)
    command = GRAPHICS if answer.failure and sys.platform == "linux" and not is_absent else ""
    message = answer.failure or answer.value
    return Finding("graphics", "OpenGL", not answer.failure, message, command)


def render_sphere() -> str:
    """Render a sphere with the project's settings; return what rendered it.

    Raises:
        ValueError: The sphere is not visible.
    """
    import pyvista as pv

    from ...report.pictures import scene

    assert scene  # its import sets up rendering

    plotter = pv.Plotter(off_screen=True, window_size=[64, 64])
    plotter.set_background("white")
    plotter.add_mesh(pv.Sphere(), color="black", lighting=False)
    image = plotter.screenshot(return_img=True)
    dark_share = float((image.max(axis=2) < 100).mean())
    if not 0.05 < dark_share < 0.95:
        raise ValueError("the picture that OpenGL renders is empty")
    return f"a picture is rendered ({type(plotter.render_window).__name__})"


def check_cad(seconds: float) -> Finding:
    """Check that OpenCascade and manifold3d cut a box."""
    answer = call(__name__, "cut_box", seconds=seconds)
    message, command = answer.failure or answer.value, system_command(answer.failure)
    return Finding("cad", "CAD kernels", not answer.failure, message, command)


def cut_box() -> str:
    """Cut a box of 10 x 20 x 10 mm from one of 10 x 20 x 30 mm with each CAD kernel.

    Raises:
        ValueError: The volume is wrong.
    """
    import manifold3d
    from build123d import Box, Pos

    solid = Box(10, 20, 30) - Pos(0, 0, 10) * Box(10, 20, 10)
    mesh = manifold3d.Manifold.cube((10, 20, 30)) - manifold3d.Manifold.cube((10, 20, 10))
    for name, volume in (("OpenCascade", solid.volume), ("manifold3d", mesh.volume())):
        if abs(volume - BOX_VOLUME_MM3) > MAX_VOLUME_ERROR_MM3:
            raise ValueError(
                f"{name} cuts a box to {volume:g} mm3, which should be {BOX_VOLUME_MM3}"
            )
    return "OpenCascade and manifold3d cut a box"


def check_solver(seconds: float) -> Finding:
    """Check the linear solver of the simulation."""
    answer = call(__name__, "solve_equations", seconds=seconds)
    message = answer.failure or f"{answer.value} solves equations"
    return Finding("solver", "solver", not answer.failure, message)


def solve_equations() -> str:
    """Solve a small system with the simulation's solver; return the name of the solver.

    Raises:
        ValueError: The solution is wrong.
    """
    import numpy as np
    from scipy import sparse

    from ...mechanics.solver.linear_solver import make_solver

    n = 50
    matrix = sparse.diags([[-1.0] * (n - 1), [2.0] * n, [-1.0] * (n - 1)], [-1, 0, 1], format="csr")
    solver = make_solver()
    solver.factor(sparse.triu(matrix, format="csr"))
    right = np.arange(1.0, n + 1)
    residual = float(np.abs(matrix @ solver.solve(right) - right).max())
    if not residual < MAX_RESIDUAL:
        raise ValueError(f"{solver.name} solves equations wrongly (by {residual:g})")
    return solver.name


def check_slicers() -> Finding:
    """Check whether there is a slicer; any of them suffices."""
    slicers = []
    for slicer, names in _SLICERS.items():
        paths = [p for p in map(shutil.which, names) if p]
        application = Path(f"/Applications/{slicer}.app")
        if sys.platform == "darwin" and application.exists():
            paths.append(str(application))
        slicers += [f"{slicer} ({path})" for path in paths[:1]]
    message = ", ".join(slicers) or f"none of {', '.join(_SLICERS)} is on PATH"
    return Finding("programs", "slicer", bool(slicers), message, needed_for=PRINTING_USE)


def check_gamepad(seconds: float) -> Finding:
    """Check that a virtual gamepad can be plugged in."""
    answer = call(__name__, "open_gamepad", seconds=seconds)
    message = answer.failure.removeprefix("gamepad: ") or answer.value
    return Finding("outputs", "gamepad", not answer.failure, message, "", "--output gamepad")


def open_gamepad() -> str:
    """Plug a virtual gamepad in and out.

    Raises:
        OutputError: The machine cannot have one.
    """
    from ...runtime.outputs.gamepad_output import GamepadOutput
    from ...runtime.outputs.settings import GamepadSettings

    GamepadOutput(GamepadSettings()).close()
    return "a virtual gamepad can be plugged in"


def check_midi(seconds: float) -> Finding:
    """Check that MIDI ports can be listed."""
    answer = call(__name__, "count_midi_ports", seconds=seconds)
    message, command = answer.failure or answer.value, system_command(answer.failure)
    message = message.removeprefix("midi: ")
    return Finding("outputs", "MIDI", not answer.failure, message, command, "--output midi")


def count_midi_ports() -> str:
    """Return the number of ports that other programs have open.

    Raises:
        OutputError: The machine has no MIDI.
    """
    from ...runtime.outputs.midi_ports import SystemPorts

    return f"{len(SystemPorts().names(inputs=False))} ports of other programs"
