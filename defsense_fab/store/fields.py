"""What the simulate stage leaves: a displacement field a state, and their index."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import meshio
import numpy as np

from ..core.arrays import Bool, Float
from ..core.device.build_folder import BUILD_AGAIN
from ..core.storage import typed_json
from ..core.storage.files import digest
from ..mechanics.elements.tet10 import QuadraticMesh
from ..mechanics.solver import fields
from .vtu_file import read_vtu

FOLDER, INDEX = "fields", "fields/index.json"
#: Fields are stored to this many decimals of a mm: what threads change in the last digits of a
#: solution must not reach the layout.
_DECIMALS = 5
_LONGEST = 80  # characters of a state in the name of a file


@dataclass(frozen=True)
class StateRecord:
    """A solved state: its name, how much of each pose it has, whether it is held out of the design,
    the solver's status; counts of iterations, factorisations and load steps; residual relative to
    the largest nodal force; stored energy (N mm)."""

    state: str
    weights: Mapping[str, float]
    held_out: bool
    status: str
    iterations: int
    factors: int
    steps: int
    residual: float
    energy: float


@dataclass(frozen=True)
class FieldIndex:
    """`fields/index.json`: the model and the solver by name, warnings, states in their order."""

    SCHEMA: ClassVar[int] = 2

    material_model: str
    solver: str
    warnings: tuple[str, ...]
    states: tuple[StateRecord, ...]


@dataclass(frozen=True)
class Fields:
    """`names` of s states, how much of each pose they have, which of them are `held_out` (s,) of
    the design, displacements (s, n, 3) mm, largest principal `strains` (s, n)."""

    names: tuple[str, ...]
    weights: tuple[Mapping[str, float], ...]
    held_out: Bool
    displacements: Float
    strains: Float

    @staticmethod
    def of(states: Sequence[StateRecord], fields: Sequence[tuple[Float, Float]]) -> Fields:
        """Combine states with the displacements (n, 3), mm, and strains (n,) of each."""
        return Fields(
            tuple(s.state for s in states),
            tuple(s.weights for s in states),
            np.array([s.held_out for s in states], bool),
            np.array([u for u, _ in fields], float),
            np.array([strain for _, strain in fields], float),
        )


def save_index(folder: Path, index: FieldIndex) -> None:
    """`fields/index.json`. Raises StorageError."""
    typed_json.save(folder / INDEX, index)


def load_index(folder: Path) -> FieldIndex:
    """Raises StorageError."""
    return typed_json.load(folder / INDEX, FieldIndex, BUILD_AGAIN)


def field_path(folder: Path, state: str) -> Path:
    """The VTU of a state."""
    return folder / FOLDER / f"{state_file(state)}.vtu"


def state_file(state: str) -> str:
    """A state's name as every file system takes it: mixtures are told as 0.5*bend+1*twist, and may
    be of many poses."""
    name = state.replace("*", "-")
    return name if len(name) <= _LONGEST else f"{name[:_LONGEST]}-{digest(state)}"


def save_field(
    path: Path, mesh: QuadraticMesh, u: Float, stats: Mapping[str, float]
) -> tuple[Float, Float]:
    """Write the displacements of a state, with deformation gradients and stretches, as VTU.

    Args:
        path: File to write.
        mesh: Quadratic mesh with n nodes.
        u: Displacements (n, 3), mm.
        stats: Statistics of the solve, stored as field data.

    Returns:
        The displacements (n, 3), mm, as they are stored, and the largest principal strains (n,).
    """
    u = np.round(u, _DECIMALS)
    F = fields.deformation_gradient_at_nodes(mesh, u)
    stretches = fields.principal_stretches(F)
    meshio.write(
        path,
        meshio.Mesh(
            mesh.nodes,
            [("tetra10", mesh.cells)],
            point_data={
                "displacement": u,
                "strain": stretches[:, 0] - 1,
                "principal_stretches": stretches,
                "deformation_gradient": F.reshape(-1, 9),
            },
            field_data={k: np.array([v]) for k, v in stats.items()},
        ),
    )
    return u, stretches[:, 0] - 1


def load_fields(folder: Path) -> Fields:
    """Return the fields of all states of a build. Raises StorageError."""
    states = load_index(folder).states
    data = [read_vtu(field_path(folder, s.state)).point_data for s in states]
    return Fields.of(states, [(d["displacement"], d["strain"]) for d in data])


def load_levels(folder: Path, pose: str) -> dict[float, Float]:
    """Displacements (n, 3) mm of a pose alone at each level that a build has; none without fields.
    Raises StorageError."""
    if not (folder / INDEX).exists():
        return {}
    return {
        float(s.weights[pose]): np.asarray(
            read_vtu(field_path(folder, s.state)).point_data["displacement"], float
        )
        for s in load_index(folder).states
        if set(s.weights) == {pose}
    }


def load_strain(folder: Path, state: str) -> Float:
    """Largest principal strain (n,) of a state."""
    return np.asarray(read_vtu(field_path(folder, state)).point_data["strain"], float)
