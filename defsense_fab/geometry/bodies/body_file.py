"""A body from a file, read in a process of its own.

Readers of CAD and mesh files are native code, which a broken file may end or keep for ever, and
which may ask for any amount of memory.
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
from .child_process import Failure, end_with_parent, finished, loaded_meanwhile, refusal
from .mesh_files import kind_of_file

_TASK, _SURFACE, _RESULT, _SOLID = "task.json", "surface.npz", "result.json", "solid.brep"
_TESSELLATION = 1e-3  # of the body's size
_ANY_SIZE = (1e-6, 1e9)
#: Of the process that reads, bytes: what a file asks for beyond it is refused.
MOST_MEMORY = 8 * 2**30


@dataclass(frozen=True)
class FileBody:
    """The body of a file: its `surface`, the enclosed `volume` (exact of STEP), its `solid` where
    that was asked for and it is CAD; what was `repaired`. Both are in mm where the format has a
    `unit`, of so many mm, else in the file's; that is 1 then."""

    surface: Surface
    volume: float
    repaired: tuple[str, ...]
    solid: Any = None
    unit: float = 1.0


def read_body_file(path: Path, limit: float = 120.0) -> FileBody:
    """The body in a STEP or mesh file of which nothing is known, in its unit, with its cavities
    filled. Raises BodyError where it is not one closed solid, and where reading takes more than
    `limit` s; it names the file without its folder."""
    task = {
        "step": path.suffix.lower() in (".step", ".stp"), "scale": 1.0, "sizes": _ANY_SIZE,
        "tolerance": _TESSELLATION, "relative": True, "fill_cavities": True,
    }  # fmt: skip
    return _read(path, path.name, task, limit, None, "simplify the body: the file is too large or"
                 " too complicated")  # fmt: skip


def read_step_body(
    path: Path, sizes: tuple[float, float], tolerance: float, fill_cavities: bool, limit: float
) -> FileBody:
    """The solid of a STEP file, with facets no further than `tolerance` mm from it. Raises
    BodyError as `cad_solid` does, and where reading takes more than `limit` s."""
    kind = _kind(path)
    if kind not in (".step", None):
        raise BodyError(
            f'{path}: is no STEP file but {kind[1:].upper()}; write mesh = "{path.name}" under'
            " [body]",
            code="wrong-file-format",
            suffix=kind,
        )
    task = {
        "step": True, "sizes": sizes, "tolerance": tolerance, "relative": False,
        "fill_cavities": fill_cavities,
    }  # fmt: skip
    # Both processes need the CAD kernel: this one loads it meanwhile.
    with loaded_meanwhile("brep") as brep:
        return _read(path, str(path), task, limit, brep)


def read_mesh_body(
    path: Path, scale: float, sizes: tuple[float, float], fill_cavities: bool, limit: float
) -> FileBody:
    """The surface in a file of a mesh times `scale`, repaired. Raises BodyError as `read_mesh`
    does, and where reading takes more than `limit` s."""
    task = {"step": False, "scale": scale, "sizes": sizes, "fill_cavities": fill_cavities}
    return _read(path, str(path), task, limit, None)


def _kind(path: Path) -> str | None:
    try:
        return kind_of_file(path.read_bytes())
    except OSError as error:
        raise BodyError(
            f"{path}: cannot be read: {error.strerror}", code="file-unreadable"
        ) from None


def _read(
    path: Path,
    shown: str,
    task: dict[str, Any],
    limit: float,
    brep: Callable[[], ModuleType] | None,
    slow: str = "simplify the body, or raise [body] time_limit in device.toml",
) -> FileBody:
    failure = Failure(
        BodyError,
        f"{shown}: reading it",
        "write the file again from the program that made it",
        slow,
    )

    def give(folder: Path) -> None:
        write_json(folder / _TASK, task | {"path": str(path.absolute()), "solid": brep is not None})

    with finished(__name__, give, _RESULT, limit, failure) as folder:
        made = json.loads((folder / _RESULT).read_text(encoding="utf-8"))
        if "refused" in made:
            raise refusal(made, made["refused"].replace(str(path.absolute()), shown))
        with np.load(folder / _SURFACE) as data:
            surface = Surface(data["vertices"], data["faces"])
        body = brep().read_brep(folder / _SOLID)[0] if brep else None
    return FileBody(surface, made["volume"], tuple(made["repaired"]), body, made["unit"])


def _main(folder: Path) -> None:
    end_with_parent()
    limit_memory(MOST_MEMORY)
    task = json.loads((folder / _TASK).read_text(encoding="utf-8"))
    path = Path(task["path"])
    try:
        result = _made(path, task, folder)
    except BodyError as error:
        result = {"refused": str(error), "code": error.code, "data": error.data}
    except MemoryError:
        result = {
            "refused": f"{path}: reading it takes more than {MOST_MEMORY / 2**30:.0f} GB of memory;"
            " simplify the body",
            "code": "file-too-large",
            "data": {},
        }
    write_json(folder / _RESULT, result)


def _made(path: Path, task: dict[str, Any], folder: Path) -> dict[str, Any]:
    sizes, unit = (task["sizes"][0], task["sizes"][1]), 1.0
    if not task["step"]:
        from .mesh_repair import read_mesh

        surface, repaired, unit = read_mesh(path, task["scale"], sizes, task["fill_cavities"])
        volume = surface.volume
    else:
        from ..kernels import brep, occ
        from .cad_solid import cad_solid

        cad = cad_solid(
            occ.read_step(path), str(path), sizes, task["tolerance"], task["relative"],
            task["fill_cavities"],
        )  # fmt: skip
        surface, volume, repaired = cad.surface, cad.volume, cad.repairs
        if task["solid"]:
            brep.write_brep([cad.solid], folder / _SOLID)
    np.savez(folder / _SURFACE, vertices=surface.vertices, faces=surface.faces)
    return {"volume": volume, "repaired": list(repaired), "unit": unit}


if __name__ == "__main__":
    _main(Path(sys.argv[1]))
