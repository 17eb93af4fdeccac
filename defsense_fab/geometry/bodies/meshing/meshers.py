"""A mesher run on a surface in a process of its own, which tells how long it takes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ....core.arrays import Float
from ....core.errors import MeshingError
from ....core.mesh import Surface, TetMesh
from ..child_process import OUT_OF_MEMORY, Failure, finished
from . import netgen

#: A mesher that takes this many times as long as is usual gets advice said.
_LONG = 3.0


class UnusableMesherError(MeshingError):
    """A mesher that is not installed as it should be: another one would hide that."""


@dataclass(frozen=True)
class Watch:
    """What all runs of a way may take together (`limit`, s, since it was `begun`), and who is told
    of it: `doing` says what it is, `usual` how long it takes on a machine that is free (s),
    `otherwise` what is done when it fails."""

    limit: float
    tell: Callable[[str], None]
    doing: str
    usual: float
    otherwise: str
    begun: float = field(default_factory=time.monotonic)

    def left(self) -> float:
        """Of the limit, s. Raises MeshingError where there is nothing."""
        left = self.limit - (time.monotonic() - self.begun)
        if left <= 0:
            raise MeshingError(
                f"the mesher did not end within {round(self.limit, 2):g} s, or did not begin",
                code="time-limit-exceeded",
                limit=self.limit,
            )
        return left

    def passed(self) -> None:
        """Tell that the run goes on."""
        seconds = time.monotonic() - self.begun
        text = f"{self.doing}: {seconds:.0f} s, usually {self.usual:.0f} s"
        if seconds > _LONG * self.usual:
            text += (
                f"; given up after {self.limit:.0f} s, then {self.otherwise}; a larger [mesh]"
                " edge_length or a surface of fewer triangles is quicker"
            )
        self.tell(text)


def run(mesher: ModuleType, surface: Surface, task: Mapping[str, Any], watch: Watch) -> TetMesh:
    """The tets that a mesher makes. Raises MeshingError, UnusableMesherError."""
    name, package = ("Netgen", "netgen-mesher") if mesher is netgen else ("fTetWild", "pytetwild")
    failure = Failure(MeshingError, name, "", "")

    def give(folder: Path) -> None:
        faces = np.asarray(surface.faces, np.int32)
        np.savez(folder / mesher.IN, vertices=surface.vertices, faces=faces, **task)

    with (
        finished(
            mesher.__name__, give, mesher.OUT, watch.left(), failure, on_wait=watch.passed
        ) as folder,
        np.load(folder / mesher.OUT) as made,
    ):
        if "missing" in made:
            raise UnusableMesherError(
                f"{name} cannot be imported ({made['missing']}), so that the mesh would be another"
                f" one than elsewhere; install {package} and what it needs, or mesh the body on"
                " another system: docs/platforms.md",
                code="mesher-missing",
                mesher=name,
                reason=str(made["missing"]),
            )
        raise_told(made, name)
        return tidy(np.asarray(made["nodes"], float), np.asarray(made["tets"], np.int64))


def raise_told(made: Mapping[str, Any], who: str) -> None:
    """The error that is in what a child left, if one is. Raises MemoryError, MeshingError."""
    if "error" in made:
        told = str(made["error"])
        if told == OUT_OF_MEMORY:
            raise MemoryError
        raise MeshingError(f"{who} failed: {told}", code="mesher-failed")


def tidy(nodes: Float, tets: Any) -> TetMesh:
    """Nodes (n, 3) and tets (m, 4), all turned outwards, without those that have no volume."""
    if len(tets) == 0:
        raise MeshingError(
            "no tets were made, so the triangles cut each other or leave a gap", code="no-tets"
        )
    x = nodes[tets]
    volume = np.linalg.det(x[:, 1:] - x[:, :1]) / 6
    tets = np.where((volume < 0)[:, None], tets[:, [0, 2, 1, 3]], tets)
    tets = tets[np.abs(volume) > 1e-9 * np.abs(volume).mean()]
    used, index = np.unique(tets, return_inverse=True)
    return TetMesh(nodes[used], index.reshape(-1, 4).astype(np.int64))
