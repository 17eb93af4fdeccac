"""What libraries must be able to do here: render a picture, cut a solid, solve equations."""

from __future__ import annotations

import sys

from .finding import Finding, judged
from .isolated import call
from .system_libraries import GRAPHICS, system_command


def check_graphics(seconds: float) -> Finding:
    """OpenGL without a screen."""
    answer = call(__name__, "render", seconds=seconds)
    told = answer.trouble or answer.value
    absent = answer.trouble.startswith(ModuleNotFoundError.__name__)  # told with the libraries
    return judged("graphics", "OpenGL", not answer.trouble, told,
                  command=GRAPHICS if sys.platform == "linux" and not absent else "")  # fmt: skip


def render() -> str:
    """A sphere, by the project's own settings; what drew it. Raises ValueError where it is not
    seen."""
    import pyvista as pv

    from ...report.pictures import scene

    assert scene

    plotter = pv.Plotter(off_screen=True, window_size=[64, 64])
    plotter.set_background("white")
    plotter.add_mesh(pv.Sphere(), color="black", lighting=False)
    image = plotter.screenshot(return_img=True)
    dark = float((image.max(axis=2) < 100).mean())
    if not 0.05 < dark < 0.95:
        raise ValueError("the picture that OpenGL renders is empty")
    return f"a picture is rendered ({type(plotter.render_window).__name__})"


def check_cad(seconds: float) -> Finding:
    """OpenCascade and manifold3d cut a box."""
    answer = call(__name__, "cut", seconds=seconds)
    return judged("cad", "CAD kernels", not answer.trouble, answer.trouble or answer.value,
                  command=system_command(answer.trouble))  # fmt: skip


def cut() -> str:
    """A box of 10 x 20 x 30 mm less one of 10 x 20 x 10 mm. Raises ValueError for others."""
    import manifold3d
    from build123d import Box, Pos

    solid = Box(10, 20, 30) - Pos(0, 0, 10) * Box(10, 20, 10)
    mesh = manifold3d.Manifold.cube((10, 20, 30)) - manifold3d.Manifold.cube((10, 20, 10))
    for name, volume in (("OpenCascade", solid.volume), ("manifold3d", mesh.volume())):
        if abs(volume - 4000) > 1e-2:
            raise ValueError(f"{name} cuts a box to {volume:g} mm3, which should be 4000")
    return "OpenCascade and manifold3d cut a box"


def check_solver(seconds: float) -> Finding:
    """Which solver the simulation gets."""
    answer = call(__name__, "solve", seconds=seconds)
    told = answer.trouble or f"{answer.value} solves equations"
    return judged("solver", "solver", not answer.trouble, told)


def solve() -> str:
    """A small system by the simulation's own solver; its name. Raises ValueError where it is
    wrong."""
    import numpy as np
    from scipy import sparse

    from ...mechanics.solver.linear_solver import make_solver

    n = 50
    matrix = sparse.diags([[-1.0] * (n - 1), [2.0] * n, [-1.0] * (n - 1)], [-1, 0, 1], format="csr")
    solver = make_solver()
    solver.factor(sparse.triu(matrix, format="csr"))
    right = np.arange(1.0, n + 1)
    wrong = float(np.abs(matrix @ solver.solve(right) - right).max())
    if not wrong < 1e-8:
        raise ValueError(f"{solver.name} solves equations wrongly (by {wrong:g})")
    return solver.name
