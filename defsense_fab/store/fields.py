"""Results of the stage "simulate": a displacement field for each state, and their index."""

from __future__ import annotations

import shutil
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
from .mesh import read_vtu

FOLDER, INDEX = "fields", "fields/index.json"
#: Fields of a body that its printed traces stiffen, which replace those of the body alone.
TRACED = "fields-with-traces"
# Decimals of displacements in mm: the last digits of a solution depend on the number of threads,
# and must not affect the layout.
_DECIMALS = 5
_MAX_NAME_LENGTH = 80  # of a state in the name of a file


@dataclass(frozen=True)
class StateRecord:
    """A solved state.

    Attributes:
        state: Name, as in "bend@1" or "0.5*bend+1*twist".
        weights: Amplitude of each pose.
        held_out: Whether it is held out of the design.
        status: Status of the solver.
        iterations: Number of Newton iterations.
        factors: Number of factorizations.
        steps: Number of load steps.
        residual: Residual relative to the largest nodal force.
        energy: Stored energy, N mm.
    """

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
    """The content of `fields/index.json`.

    Attributes:
        material_model: Name of the material model.
        solver: Name of the linear solver.
        warnings: What is doubtful about the simulation.
        states: The states, in the order of the fields.
    """

    SCHEMA: ClassVar[int] = 2

    material_model: str
    solver: str
    warnings: tuple[str, ...]
    states: tuple[StateRecord, ...]


@dataclass(frozen=True)
class Fields:
    """The fields of s states.

    Attributes:
        names: Names of the states.
        weights: Amplitude of each pose, by state.
        held_out: Which states (s,) are held out of the design.
        displacements: Displacements (s, n, 3) of the n quadratic nodes, mm.
        strains: Largest principal strain (s, n) at each node.
    """

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
    """Write `fields/index.json`. Raises StorageError."""
    typed_json.save(folder / INDEX, index)


def load_index(folder: Path) -> FieldIndex:
    """Return the index of a build's fields. Raises StorageError."""
    return typed_json.load(folder / INDEX, FieldIndex, BUILD_AGAIN)


def field_path(folder: Path, state: str, fields: str = FOLDER) -> Path:
    """Return the path of a state's VTU file; `fields` is `FOLDER` or `TRACED`."""
    return folder / fields / f"{state_file(state)}.vtu"


def state_file(state: str) -> str:
    """Return a state's name as part of a file name, on any file system."""
    name = state.replace("*", "-")
    return name if len(name) <= _MAX_NAME_LENGTH else f"{name[:_MAX_NAME_LENGTH]}-{digest(state)}"


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


def save_traced_fields(
    folder: Path, mesh: QuadraticMesh, index: FieldIndex, displacements: Float
) -> Fields:
    """Write the fields of a body with printed traces.

    Args:
        folder: The build's folder.
        mesh: Quadratic mesh with n nodes.
        index: Index of the s states.
        displacements: Displacements (s, n, 3), mm.

    Returns:
        The fields as they are stored.
    """
    shutil.rmtree(folder / TRACED, ignore_errors=True)
    (folder / TRACED).mkdir()
    saved = [
        save_field(field_path(folder, s.state, TRACED), mesh, u, {})
        for s, u in zip(index.states, displacements, strict=True)
    ]
    return Fields.of(index.states, saved)


def load_fields(folder: Path, has_traces: bool = False) -> Fields:
    """Return the fields of all states of a build.

    Args:
        folder: The build's folder.
        has_traces: Whether to return those with printed traces, if the build has any.

    Raises:
        StorageError: A file is missing or damaged.
    """
    states = load_index(folder).states
    fields = TRACED if has_traces and (folder / TRACED).is_dir() else FOLDER
    data = [read_vtu(field_path(folder, s.state, fields)).point_data for s in states]
    return Fields.of(states, [(d["displacement"], d["strain"]) for d in data])


def load_field(folder: Path, state: str) -> Float:
    """Return the displacements (n, 3), mm, of a state. Raises StorageError."""
    return np.asarray(read_vtu(field_path(folder, state)).point_data["displacement"], float)


def load_levels(folder: Path, pose: str) -> dict[float, Float]:
    """Return the displacements (n, 3), mm, of a pose alone, by amplitude.

    Returns:
        The levels that a build has; none without fields.

    Raises:
        StorageError: A file is damaged.
    """
    if not (folder / INDEX).exists():
        return {}
    return {
        float(s.weights[pose]): load_field(folder, s.state)
        for s in load_index(folder).states
        if set(s.weights) == {pose}
    }
