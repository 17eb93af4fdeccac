"""Checks of the machine: processor, memory, disk, graphics, kernels, slicers and outputs."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path

from ...core.machine.optional_libraries import pip_install
from .checks import GRAPHICS, Finding, call, make_finding, system_command

_GB = 1e9
MIN_DISK_GB, MIN_MEMORY_GB = 1.0, 2.0
#: Names of each slicer on PATH; on macOS it is also found among the applications.
_SLICERS = {
    "PrusaSlicer": ("prusa-slicer", "PrusaSlicer", "prusa-slicer-console"),
    "OrcaSlicer": ("orca-slicer", "OrcaSlicer"),
    "Cura": ("cura", "UltiMaker-Cura", "UltiMaker-Cura.AppImage", "CuraEngine"),
}
_UINPUT = Path("/dev/uinput")
BOX_VOLUME_MM3, MAX_VOLUME_ERROR_MM3 = 4000, 1e-2
MAX_RESIDUAL = 1e-8  # of the solved equations


def check_machine(seconds: float) -> list[Finding]:
    """Check cores, memory, disk, and the cache of meshes."""
    return [_check_cores(), *_check_memory(), _check_disk(), check_cache(seconds)]


def _check_cores() -> Finding:
    if sys.platform == "linux":
        count = len(os.sched_getaffinity(0))
    else:
        count = os.cpu_count() or 1
    return make_finding("machine", "cores", True, str(count))


def _check_memory() -> list[Finding]:
    """Check the memory, on systems that report it."""
    if sys.platform == "win32":
        return []
    size = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / _GB
    text = f"{size:.1f} GB ({MIN_MEMORY_GB:g} GB are required)"
    return [make_finding("machine", "memory", size >= MIN_MEMORY_GB, text)]


def _check_disk() -> Finding:
    free = shutil.disk_usage(Path.cwd()).free / _GB
    text = f"{free:.1f} GB free in {Path.cwd()} ({MIN_DISK_GB:g} GB are required)"
    return make_finding("machine", "disk", free >= MIN_DISK_GB, text)


def check_cache(seconds: float) -> Finding:
    """Check the cache of meshes. A cache that cannot be written costs time but stops no build."""
    answer = call(__name__, "cache_folder", seconds=seconds)
    use = "meshing a body only once"
    if answer.trouble:
        return make_finding("machine", "cache", False, answer.trouble, needed_for=use)
    folder = Path(answer.value)
    try:
        existing = next(p for p in (folder, *folder.parents) if p.exists())
        with tempfile.TemporaryFile(dir=existing):
            pass
        size = sum(p.stat().st_size for p in folder.glob("*.npz")) / _GB
    except OSError as error:
        return make_finding(
            "machine",
            "cache",
            False,
            f"{folder}: {error.strerror}; set DEFSENSE_CACHE to a folder that can be written",
            command=_set_cache_command(),
            needed_for=use,
        )
    return make_finding("machine", "cache", True, f"{folder} ({size:.2f} GB)", needed_for=use)


def _set_cache_command() -> str:
    folder = Path(tempfile.gettempdir()) / "defsense-cache"
    return f"set DEFSENSE_CACHE={folder}" if os.name == "nt" else f"export DEFSENSE_CACHE={folder}"


def cache_folder() -> str:
    """Return the folder in which meshes are kept."""
    from ...geometry.bodies.meshing import mesh_store

    return str(mesh_store.cache_folder().resolve())


def check_graphics(seconds: float) -> Finding:
    """Check that OpenGL renders without a screen."""
    answer = call(__name__, "render_sphere", seconds=seconds)
    # A missing module is reported with the libraries.
    is_absent = answer.trouble.startswith(ModuleNotFoundError.__name__)
    command = GRAPHICS if sys.platform == "linux" and not is_absent else ""
    text = answer.trouble or answer.value
    return make_finding("graphics", "OpenGL", not answer.trouble, text, command=command)


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
    text, command = answer.trouble or answer.value, system_command(answer.trouble)
    return make_finding("cad", "CAD kernels", not answer.trouble, text, command=command)


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
    text = answer.trouble or f"{answer.value} solves equations"
    return make_finding("solver", "solver", not answer.trouble, text)


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
    text = ", ".join(slicers) or f"none of {', '.join(_SLICERS)} is on PATH"
    use = "printing the parts here"
    return make_finding("programs", "slicer", bool(slicers), text, needed_for=use)


def check_gamepad(seconds: float) -> Finding:
    """Check uinput and evdev, which a virtual gamepad needs."""
    use = "--output gamepad"
    if sys.platform != "linux" or not _UINPUT.exists():
        text, command = f"there is no {_UINPUT}", ""
        if sys.platform == "linux":
            command = "sudo modprobe uinput"
        return make_finding("outputs", "gamepad", False, text, command=command, needed_for=use)
    if not os.access(_UINPUT, os.W_OK):
        text, command = (
            f"no permission to write {_UINPUT}",
            "sudo setfacl -m u:$USER:rw /dev/uinput",
        )
        return make_finding("outputs", "gamepad", False, text, command=command, needed_for=use)
    libraries = __name__.rpartition(".")[0] + ".libraries"
    trouble = call(libraries, "import_module", "evdev", seconds=seconds).trouble
    text = f"evdev: {trouble}" if trouble else f"{_UINPUT} and evdev are available"
    command = pip_install("evdev")
    return make_finding("outputs", "gamepad", not trouble, text, command=command, needed_for=use)


def check_midi(seconds: float) -> Finding:
    """Check the MIDI system."""
    answer = call(__name__, "count_midi_ports", seconds=seconds)
    text = f"no MIDI here ({answer.trouble})" if answer.trouble else answer.value
    return make_finding(
        "outputs",
        "MIDI",
        not answer.trouble,
        text,
        command=system_command(answer.trouble),
        needed_for="--output midi",
    )


def count_midi_ports() -> str:
    """Return the number of ports that other programs have open."""
    import rtmidi

    return f"{rtmidi.MidiOut().get_port_count()} ports of other programs"
