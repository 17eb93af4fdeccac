"""A mesher run on a surface in a process of its own, which tells how long it takes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ....core.arrays import Float
from ....core.errors import MeshingError
from ....core.mesh import Surface, TetMesh
from ..child_process import Failure, finished
from . import netgen

#: A mesher that takes this many times as long as is usual gets advice said.
_LONG = 3.0


class UnusableMesherError(MeshingError):
    """A mesher that is not installed as it should be: another one would hide that."""


@dataclass(frozen=True)
class Watch:
    """What a run may take (`limit`, s), and who is told of it: `doing` says what it is, `usual` how
    long it takes on a machine that is free (s), `otherwise` what is done when it fails."""

    limit: float
    tell: Callable[[str], None]
    doing: str
    usual: float
    otherwise: str

    def passed(self, seconds: float) -> None:
        """Tell that the run goes on."""
        text = f"{self.doing}: {seconds:.0f} s, usually {self.usual:.0f} s"
        if seconds > _LONG * self.usual:
            text += (
                f"; given up after {self.limit:.0f} s, then {self.otherwise}; a larger [mesh]"
                " edge_length or a surface of fewer triangles is quicker"
            )
        self.tell(text)


def run(mesher: ModuleType, surface: Surface, task: Mapping[str, Any], watch: Watch) -> TetMesh:
    """The tets that a mesher makes. Raises MeshingError, UnusableMesherError."""
    name = "Netgen" if mesher is netgen else "fTetWild"
    failure = Failure(MeshingError, name, "", "")
    begun = time.monotonic()

    def give(folder: Path) -> None:
        faces = np.asarray(surface.faces, np.int32)
        np.savez(folder / mesher.IN, vertices=surface.vertices, faces=faces, **task)

    def waiting() -> None:
        watch.passed(time.monotonic() - begun)

    with (
        finished(
            mesher.__name__, give, mesher.OUT, watch.limit, failure, on_wait=waiting
        ) as folder,
        np.load(folder / mesher.OUT) as made,
    ):
        if "missing" in made:
            raise UnusableMesherError(
                f"{name} cannot be imported ({made['missing']}), so that the mesh would be another"
                " one than elsewhere; install netgen-mesher and what it needs"
            )
        if "error" in made:
            raise MeshingError(f"{name} failed: {made['error']}")
        return tidy(np.asarray(made["nodes"], float), np.asarray(made["tets"], np.int64))


def tidy(nodes: Float, tets: Any) -> TetMesh:
    """Nodes (n, 3) and tets (m, 4), all turned outwards, without those that have no volume."""
    if len(tets) == 0:
        raise MeshingError("no tets were made, so the triangles cut each other or leave a gap")
    x = nodes[tets]
    volume = np.linalg.det(x[:, 1:] - x[:, :1]) / 6
    tets = np.where((volume < 0)[:, None], tets[:, [0, 2, 1, 3]], tets)
    tets = tets[np.abs(volume) > 1e-9 * np.abs(volume).mean()]
    used, index = np.unique(tets, return_inverse=True)
    return TetMesh(nodes[used], index.reshape(-1, 4).astype(np.int64))
