"""A body from a file of which nothing is known: read in a process of its own.

Readers of CAD and mesh files are native code, which a broken file may end or keep for ever.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.errors import BodyError
from ...core.files import write_json
from ...core.mesh import Surface
from .child_process import Failure, end_with_parent, finished

_TASK, _SURFACE, _RESULT = "task.json", "surface.npz", "result.json"
_TESSELLATION = 1e-3  # of the body's size


@dataclass(frozen=True)
class ForeignBody:
    """The `surface` in the file's unit; whether the file tells its unit (`in_mm`); what was
    `repaired`."""

    surface: Surface
    in_mm: bool
    repaired: tuple[str, ...]


def read_foreign(path: Path, limit: float = 120.0) -> ForeignBody:
    """The body in a STEP or mesh file. Raises BodyError where it is not one closed solid, and where
    reading takes more than `limit` s."""
    failure = Failure(
        BodyError,
        f"{path.name}: reading it",
        "write the file again from the program that made it",
        "simplify the body: the file is too large or too complicated",
    )

    def give(folder: Path) -> None:
        write_json(folder / _TASK, {"path": str(path.absolute())})

    with finished(__name__, give, _RESULT, limit, failure) as folder:
        made = json.loads((folder / _RESULT).read_text(encoding="utf-8"))
        if "refused" in made:
            raise BodyError(made["refused"])
        with np.load(folder / _SURFACE) as data:
            surface = Surface(data["vertices"], data["faces"])
    return ForeignBody(surface, made["in_mm"], tuple(made["repaired"]))


def _main(folder: Path) -> None:
    end_with_parent()
    path = Path(json.loads((folder / _TASK).read_text(encoding="utf-8"))["path"])
    try:
        surface, repaired = _read(path)
    except BodyError as error:
        write_json(folder / _RESULT, {"refused": str(error).replace(str(path), path.name)})
        return
    np.savez(folder / _SURFACE, vertices=surface.vertices, faces=surface.faces)
    in_mm = path.suffix.lower() in (".step", ".3mf")
    write_json(folder / _RESULT, {"in_mm": in_mm, "repaired": list(repaired)})


def _read(path: Path) -> tuple[Surface, tuple[str, ...]]:
    if path.suffix.lower() != ".step":
        from .mesh_repair import read_mesh

        return read_mesh(path, 1.0, (1e-6, 1e9))
    from ..kernels import occ

    solids = occ.read_step(path)
    if len(solids) != 1:
        raise BodyError(
            f"{path}: gives {len(solids)} solids, one is needed; fuse them or remove the rest"
        )
    return occ.tessellate(solids[0], _TESSELLATION * occ.size(solids[0])), ()


if __name__ == "__main__":
    _main(Path(sys.argv[1]))
