"""Load a device's body from a script, a STEP file or a triangle mesh: one closed solid.

Readers of CAD and mesh files are native code, which a damaged file may crash or keep busy forever,
and which may request any amount of memory. They run in a child process: `python -m` this module
with a folder.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ...core.device.device import BodySpec
from ...core.errors import BodyError
from ...core.machine.child_process import (
    ChildFailure,
    ChildLimits,
    error_from_record,
    error_record,
    run_module,
    start_child,
)
from ...core.mesh import Surface
from ...core.storage.files import write_json
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism
from ..kernels.loading import load_kernel_meanwhile
from .connector_bay import place_bay
from .mesh_files import detect_format, read_mesh
from .script_process import SourceFile, run_script

#: Largest distance of a facet from the true surface of a CAD body, mm.
TESSELLATION_MM = 0.05
#: Smallest and largest plausible body, mm: others are probably in another unit.
SIZE_RANGE_MM = (1.0, 1e4)
#: Tolerance of facets for files of unknown size, as a share of the body's size.
RELATIVE_TESSELLATION = 1e-3
#: Accepted sizes of bodies in files of unknown unit.
ANY_SIZE_RANGE = (1e-6, 1e9)
#: Memory limit of the reading process, bytes: requests of a file beyond it are refused.
MEMORY_LIMIT_BYTES = 8 * 2**30

_TASK, _SURFACE, _RESULT, _SOLID = "task.json", "surface.npz", "result.json", "solid.brep"


@dataclass(frozen=True)
class Body:
    """A device's body.

    Attributes:
        surface: Closed triangle surface: in mm, or in the lengths of a file without unit.
        volume: Enclosed volume, exact for CAD bodies.
        solid: OpenCascade TopoDS_Solid of a CAD body if it was requested, else None.
        repairs: Sentences on what was repaired.
        bay: Recess for the connector that surface and solid both have, or None.
        sources: Files that the body was made from.
        unit: Millimetres per unit of the file; 1 if the format has none.
    """

    surface: Surface
    volume: float
    solid: Any = None
    repairs: tuple[str, ...] = ()
    bay: Prism | None = None
    sources: tuple[SourceFile, ...] = ()
    unit: float = 1.0


def load_body(spec: BodySpec) -> Body:
    """Load the body that `spec` describes and cut its connector bay.

    Args:
        spec: The `[body]` section of a device.

    Returns:
        The body in the device's rest frame.

    Raises:
        BodyError: If the body is not one closed solid, lies far from the origin, or has no room
            for the bay.
    """
    body = _load(spec)
    if spec.bay is None:
        return body
    bay = place_bay(spec.bay, body.surface)
    if body.solid is None:
        rest = triangle_kernel.cut_out(
            triangle_kernel.to_manifold(body.surface, str(spec.path)), [bay]
        )
        surface, solid, volume = triangle_kernel.to_surface(rest), None, float(rest.volume())
    else:
        from ..kernels import occ

        solid = occ.cut_out(body.solid, [bay])
        surface, volume = occ.tessellate(solid, TESSELLATION_MM), occ.volume(solid)
    return replace(body, surface=surface, volume=volume, solid=solid, bay=bay)


def _load(spec: BodySpec) -> Body:
    """Load the body without its bay."""
    if spec.kind == "script":
        solids, sources = run_script(spec)
        from ..kernels import occ
        from .cad_solid import make_cad_solid

        solid, surface, repairs = make_cad_solid(
            solids,
            str(spec.path),
            SIZE_RANGE_MM,
            TESSELLATION_MM,
            is_relative=False,
            fill_cavities=spec.fill_cavities,
        )
        return Body(surface, occ.volume(solid), solid, repairs, sources=sources)
    sources = (SourceFile.from_path(spec.path),)
    task = {"sizes": SIZE_RANGE_MM, "fill_cavities": spec.fill_cavities}
    if spec.kind == "mesh":
        body = _read(spec.path, str(spec.path), task | {"scale": spec.scale}, spec.time_limit)
    else:
        _check_step(spec.path)
        task |= {"tolerance": TESSELLATION_MM, "is_relative": False}
        # Both processes need the CAD kernel: this one loads it while the other reads.
        with load_kernel_meanwhile("brep") as wait_for_brep:
            body = _read(spec.path, str(spec.path), task, spec.time_limit, wait_for_brep)
    return replace(body, sources=sources)


def _check_step(path: Path) -> None:
    """Raise BodyError if a file that should be STEP has another format."""
    try:
        suffix = detect_format(path.read_bytes())
    except OSError as error:
        raise BodyError(
            f"cannot be read: {error.strerror}", code="file-unreadable", where=path
        ) from None
    if suffix not in (".step", None):
        raise BodyError(
            f"is not a STEP file but {suffix[1:].upper()}",
            code="wrong-file-format",
            where=path,
            action=f'Write mesh = "{path.name}" under [body]',
            suffix=suffix,
        )


def read_body_file(path: Path, limit: float = 120.0) -> Body:
    """Read the body in a STEP or mesh file of unknown size, with its cavities filled.

    Args:
        path: The file.
        limit: Limit of processor time, s.

    Returns:
        The body in the file's unit.

    Raises:
        BodyError: If the file does not hold one closed solid, or reading takes too long. The error
            names the file without its folder.
    """
    task: dict[str, Any] = {"sizes": ANY_SIZE_RANGE, "fill_cavities": True}
    if path.suffix.lower() in (".step", ".stp"):
        task |= {"tolerance": RELATIVE_TESSELLATION, "is_relative": True}
    else:
        task["scale"] = 1.0
    action = "Simplify the body: the file is too large or too complicated"
    return _read(path, path.name, task, limit, timeout_action=action)


def _read(
    path: Path,
    shown_path: str,
    task: dict[str, Any],
    limit: float,
    wait_for_brep: Callable[[], ModuleType] | None = None,
    timeout_action: str = "Simplify the body, or raise [body] time_limit in device.toml",
) -> Body:
    """Read a body in a child process; with `wait_for_brep` also its solid.

    The task is for a mesh if it has a `scale`, else for a STEP file.
    """
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

    module = f"{__package__}.body"
    limits = ChildLimits.of_cpu_time(limit, MEMORY_LIMIT_BYTES)
    with run_module(module, write_task, _RESULT, limits, failure) as folder:
        result = json.loads((folder / _RESULT).read_text(encoding="utf-8"))
        if "error" in result:
            raise error_from_record(BodyError, result["error"], where=shown_path)
        with np.load(folder / _SURFACE) as data:
            surface = Surface(data["vertices"], data["faces"])
        solid = wait_for_brep().read_brep(folder / _SOLID)[0] if wait_for_brep else None
    repairs = tuple(result["repairs"])
    return Body(surface, result["volume"], solid, repairs, unit=result["unit"])


def _main(folder: Path) -> None:
    """Read the body of the task in `folder` and write it, or the error, there."""
    start_child()
    task = json.loads((folder / _TASK).read_text(encoding="utf-8"))
    path = Path(task["path"])
    try:
        result = _read_and_save(path, task, folder)
    except BodyError as error:
        result = {"error": error_record(error)}
    except MemoryError:
        limit_error = BodyError(
            f"reading it takes more than {MEMORY_LIMIT_BYTES / 2**30:.0f} GB of memory",
            code="memory-limit-exceeded",
            where=path,
            action="Simplify the body",
            limit=MEMORY_LIMIT_BYTES,
        )
        result = {"error": error_record(limit_error)}
    write_json(folder / _RESULT, result)


def _read_and_save(path: Path, task: dict[str, Any], folder: Path) -> dict[str, Any]:
    sizes, unit = (task["sizes"][0], task["sizes"][1]), 1.0
    if "scale" in task:
        surface, repairs, unit = read_mesh(path, task["scale"], sizes, task["fill_cavities"])
        volume = surface.volume
    else:
        from ..kernels import brep, occ
        from .cad_solid import make_cad_solid

        solid, surface, repairs = make_cad_solid(
            occ.read_step(path),
            str(path),
            sizes,
            task["tolerance"],
            task["is_relative"],
            task["fill_cavities"],
        )
        volume = occ.volume(solid)
        if task["solid"]:
            brep.write_brep([solid], folder / _SOLID)
    np.savez(folder / _SURFACE, vertices=surface.vertices, faces=surface.faces)
    return {"volume": volume, "repairs": list(repairs), "unit": unit}


if __name__ == "__main__":
    _main(Path(sys.argv[1]))
