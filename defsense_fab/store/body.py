"""What the body stage leaves: the surface, the exact solid where there is one, the bay."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar
from zipfile import BadZipFile

import numpy as np

from ..core.arrays import Float
from ..core.device.build_folder import BUILD_AGAIN
from ..core.errors import StorageError
from ..core.mesh import Surface
from ..core.storage import typed_json
from ..geometry.kernels.cutting_tools import Prism

FOLDER = "body"


@dataclass(frozen=True)
class BodyRecord:
    """`body/body.json`: `volume` mm^3 of the exact body, whether it is `cad`, what was repaired,
    `bounds` (2, 3) mm, and the connector bay if it has one."""

    SCHEMA: ClassVar[int] = 1

    volume: float
    cad: bool
    repairs: tuple[str, ...]
    bounds: Float
    bay: Prism | None


def save_body(folder: Path, record: BodyRecord, surface: Surface) -> None:
    """The record and the surface, into the existing `folder`/body."""
    np.savez(folder / FOLDER / "surface.npz", vertices=surface.vertices, faces=surface.faces)
    typed_json.save(folder / FOLDER / "body.json", record)


def load_body_record(folder: Path) -> BodyRecord:
    """From a build's folder. Raises StorageError."""
    return typed_json.load(folder / FOLDER / "body.json", BodyRecord, BUILD_AGAIN)


def load_surface(folder: Path) -> Surface:
    """The body's surface, in mm in the rest frame. Raises OSError where there is none, StorageError
    where it is damaged."""
    path = folder / FOLDER / "surface.npz"
    with path.open("rb") as file:
        try:
            with np.load(file) as data:
                return Surface(data["vertices"], data["faces"])
        except (AttributeError, EOFError, KeyError, ValueError, BadZipFile) as error:
            raise StorageError(f"{path}: is damaged ({error}); {BUILD_AGAIN}") from None


def load_solid(folder: Path) -> Any:
    """The body's TopoDS_Solid; None where the body is a mesh."""
    if not load_body_record(folder).cad:
        return None
    from ..geometry.kernels import occ

    return occ.read_step(folder / FOLDER / "body.step")[0]
