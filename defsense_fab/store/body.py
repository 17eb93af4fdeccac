"""Results of the stage "body": the surface, the exact solid if there is one, the connector bay."""

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
    """The content of `body/body.json`.

    Attributes:
        volume: Volume of the exact body, mm^3.
        cad: Whether there is an exact solid.
        repairs: What was repaired of a mesh.
        bounds: Lowest and highest corner (2, 3), mm.
        bay: The connector bay, if the body has one.
    """

    SCHEMA: ClassVar[int] = 1

    volume: float
    cad: bool
    repairs: tuple[str, ...]
    bounds: Float
    bay: Prism | None


def save_body(folder: Path, record: BodyRecord, surface: Surface) -> None:
    """Write the record and the surface into the existing folder `body` of a build."""
    np.savez(folder / FOLDER / "surface.npz", vertices=surface.vertices, faces=surface.faces)
    typed_json.save(folder / FOLDER / "body.json", record)


def load_body_record(folder: Path) -> BodyRecord:
    """Return the record of a build's body. Raises StorageError."""
    return typed_json.load(folder / FOLDER / "body.json", BodyRecord, BUILD_AGAIN)


def load_surface(folder: Path) -> Surface:
    """Return the surface of a build's body, mm, rest frame.

    Raises:
        OSError: There is no such file.
        StorageError: The file is damaged.
    """
    path = folder / FOLDER / "surface.npz"
    with path.open("rb") as file:
        try:
            with np.load(file) as data:
                return Surface(data["vertices"], data["faces"])
        except (AttributeError, EOFError, KeyError, ValueError, BadZipFile) as error:
            raise StorageError(
                f"is damaged ({error})", code="file-damaged", where=path, action=BUILD_AGAIN
            ) from None


def load_solid(folder: Path) -> Any:
    """Return the TopoDS_Solid of a build's body; None for a body from a mesh."""
    if not load_body_record(folder).cad:
        return None
    from ..geometry.kernels import occ

    return occ.read_step(folder / FOLDER / "body.step")[0]
