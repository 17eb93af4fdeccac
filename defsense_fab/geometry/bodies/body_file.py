"""Read a body from a STEP or mesh file in a child process.

Readers of CAD and mesh files are native code, which a damaged file may crash or keep busy forever,
and which may request any amount of memory. The child is `python -m` this module with a folder.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ...core.errors import BodyError
from ...core.machine.processes import limit_memory
from ...core.mesh import Surface
from ...core.storage.files import write_json
from .child_process import (
    ChildFailure,
    end_with_parent,
    error_from_record,
    error_record,
    load_kernel_meanwhile,
    run_module,
)
from .mesh_files import detect_format

_TASK, _SURFACE, _RESULT, _SOLID = "task.json", "surface.npz", "result.json", "solid.brep"
#: Tolerance of facets for files of unknown size, as a share of the body's size.
RELATIVE_TESSELLATION = 1e-3
#: Accepted sizes of bodies in files of unknown unit.
ANY_SIZE_RANGE = (1e-6, 1e9)
#: Memory limit of the reading process, bytes: requests of a file beyond it are refused.
MEMORY_LIMIT_BYTES = 8 * 2**30


@dataclass(frozen=True)
class FileBody:
    """The body of a file.

    Attributes:
        surface: Closed surface: in mm if the format has a unit, else in the file's lengths.
        volume: Enclosed volume, exact for STEP.
        repairs: Sentences on what was repaired.
        solid: TopoDS_Solid if it was requested and the file is CAD, else None.
        unit: Millimetres per unit of the file; 1 if the format has none.
    """

    surface: Surface
    volume: float
    repairs: tuple[str, ...]
    solid: Any = None
    unit: float = 1.0


def read_body_file(path: Path, limit: float = 120.0) -> FileBody:
    """Read the body in a STEP or mesh file of unknown size, with its cavities filled.

    Args:
        path: The file.
        limit: Time limit, s.

    Returns:
        The body in the file's unit.

    Raises:
        BodyError: If the file does not hold one closed solid, or reading takes too long. The error
            names the file without its folder.
    """
    task = {
        "step": path.suffix.lower() in (".step", ".stp"),
        "scale": 1.0,
        "sizes": ANY_SIZE_RANGE,
        "tolerance": RELATIVE_TESSELLATION,
        "is_relative": True,
        "fill_cavities": True,
    }
    action = "Simplify the body: the file is too large or too complicated"
    return _read(path, path.name, task, limit, None, action)


def read_step_body(
    path: Path, sizes: tuple[float, float], tolerance: float, fill_cavities: bool, limit: float
) -> FileBody:
    """Read the solid of a STEP file.

    Args:
        path: The file.
        sizes: Smallest and largest plausible size, mm.
        tolerance: Largest distance of a facet from the solid, mm.
        fill_cavities: Whether closed cavities are filled; otherwise they are an error.
        limit: Time limit, s.

    Returns:
        The body with its solid, mm.

    Raises:
        BodyError: As `make_cad_solid`, or if the file is not STEP, or reading takes too long.
    """
    suffix = _detect_file_format(path)
    if suffix not in (".step", None):
        raise BodyError(
            f"is not a STEP file but {suffix[1:].upper()}",
            code="wrong-file-format",
            where=path,
            action=f'Write mesh = "{path.name}" under [body]',
            suffix=suffix,
        )
    task = {
        "step": True,
        "sizes": sizes,
        "tolerance": tolerance,
        "is_relative": False,
        "fill_cavities": fill_cavities,
    }
    # Both processes need the CAD kernel: this one loads it while the other reads.
    with load_kernel_meanwhile("brep") as wait_for_brep:
        return _read(path, str(path), task, limit, wait_for_brep)


def read_mesh_body(
    path: Path, scale: float, sizes: tuple[float, float], fill_cavities: bool, limit: float
) -> FileBody:
    """Read the surface in a mesh file and repair it.

    Args:
        path: The file.
        scale: Factor from the file's lengths to mm.
        sizes: Smallest and largest plausible size, mm.
        fill_cavities: Whether closed cavities are filled; otherwise they are an error.
        limit: Time limit, s.

    Returns:
        The body, mm.

    Raises:
        BodyError: As `read_mesh`, or if reading takes too long.
    """
    task = {"step": False, "scale": scale, "sizes": sizes, "fill_cavities": fill_cavities}
    return _read(path, str(path), task, limit, None)


def _detect_file_format(path: Path) -> str | None:
    try:
        return detect_format(path.read_bytes())
    except OSError as error:
        raise BodyError(
            f"cannot be read: {error.strerror}", code="file-unreadable", where=path
        ) from None


def _read(
    path: Path,
    shown_path: str,
    task: dict[str, Any],
    limit: float,
    wait_for_brep: Callable[[], ModuleType] | None,
    timeout_action: str = "Simplify the body, or raise [body] time_limit in device.toml",
) -> FileBody:
    """Read a body in a child process; with `wait_for_brep` also its solid."""
    failure = ChildFailure(
        BodyError,
        shown_path,
        "reading it",
        "Write the file again from the program that made it",
        timeout_action,
    )

    def write_task(folder: Path) -> None:
        paths = {"path": str(path.absolute()), "solid": wait_for_brep is not None}
        write_json(folder / _TASK, task | paths)

    with run_module(__name__, write_task, _RESULT, limit, failure) as folder:
        result = json.loads((folder / _RESULT).read_text(encoding="utf-8"))
        if "error" in result:
            raise error_from_record(BodyError, result["error"], where=shown_path)
        with np.load(folder / _SURFACE) as data:
            surface = Surface(data["vertices"], data["faces"])
        solid = wait_for_brep().read_brep(folder / _SOLID)[0] if wait_for_brep else None
    return FileBody(surface, result["volume"], tuple(result["repairs"]), solid, result["unit"])


def _main(folder: Path) -> None:
    """Read the body of the task in `folder` and write it, or the error, there."""
    end_with_parent()
    limit_memory(MEMORY_LIMIT_BYTES)
    task = json.loads((folder / _TASK).read_text(encoding="utf-8"))
    path = Path(task["path"])
    try:
        result = _read_and_save(path, task, folder)
    except BodyError as error:
        result = {"error": error_record(error)}
    except MemoryError:
        limit_error = BodyError(
            f"reading it takes more than {MEMORY_LIMIT_BYTES / 2**30:.0f} GB of memory",
            code="file-too-large",
            where=path,
            action="Simplify the body",
        )
        result = {"error": error_record(limit_error)}
    write_json(folder / _RESULT, result)


def _read_and_save(path: Path, task: dict[str, Any], folder: Path) -> dict[str, Any]:
    sizes, unit = (task["sizes"][0], task["sizes"][1]), 1.0
    if not task["step"]:
        from .mesh_repair import read_mesh

        surface, repairs, unit = read_mesh(path, task["scale"], sizes, task["fill_cavities"])
        volume = surface.volume
    else:
        from ..kernels import brep, occ
        from .cad_solid import make_cad_solid

        cad = make_cad_solid(
            occ.read_step(path),
            str(path),
            sizes,
            task["tolerance"],
            task["is_relative"],
            task["fill_cavities"],
        )
        surface, volume, repairs = cad.surface, cad.volume, cad.repairs
        if task["solid"]:
            brep.write_brep([cad.solid], folder / _SOLID)
    np.savez(folder / _SURFACE, vertices=surface.vertices, faces=surface.faces)
    return {"volume": volume, "repairs": list(repairs), "unit": unit}


if __name__ == "__main__":
    _main(Path(sys.argv[1]))
