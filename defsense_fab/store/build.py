"""The results of a device's build, each read from its folder at most once."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..core.arrays import Bool
from ..core.errors import StorageError
from ..core.mesh import Surface, TetMesh
from ..mechanics.elements.point_location import PointLocator
from ..mechanics.elements.tet10 import QuadraticMesh
from .body import BodyRecord, load_body_record, load_solid, load_surface
from .fields import FieldIndex, Fields, load_fields, load_index
from .forces import ForcesRecord, load_forces
from .layout import (
    LayoutRecord,
    PredictionRecord,
    WeighedCords,
    load_layout,
    load_prediction,
    load_weighed,
)
from .manifest import MANIFEST, Manifest, load_manifest, load_parts
from .mesh import MeshRecord, load_mesh, load_mesh_record, load_region_nodes


class Build:
    """The results of one build.

    Each attribute is read from the folder when it is first used. A stage that has just computed a
    result assigns it, so that later stages do not read what was written a moment ago. Attributes
    raise StorageError for files that are missing or damaged.

    Args:
        folder: The build's folder, such as `my-device/build`.

    Attributes:
        folder: The folder that the results are read from.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @cached_property
    def body(self) -> BodyRecord:
        """The body's volume, bounds, repairs and connector bay."""
        return load_body_record(self.folder)

    @cached_property
    def surface(self) -> Surface:
        """The body's surface, mm, rest frame."""
        return load_surface(self.folder)

    @cached_property
    def solid(self) -> Any:
        """The body's TopoDS_Solid; None for bodies from meshes."""
        return load_solid(self.folder)

    @cached_property
    def mesh(self) -> TetMesh:
        """The linear tetrahedra, mm, rest frame."""
        return load_mesh(self.folder)

    @cached_property
    def mesh_record(self) -> MeshRecord:
        """The mesh's hash, density and quality."""
        return load_mesh_record(self.folder)

    @cached_property
    def region_nodes(self) -> dict[str, Bool]:
        """Which linear nodes (n,) each region contains, by its name."""
        return load_region_nodes(self.folder)

    @cached_property
    def quadratic_mesh(self) -> QuadraticMesh:
        """The quadratic tetrahedra that poses are solved on."""
        return QuadraticMesh.from_linear(self.mesh)

    @cached_property
    def locator(self) -> PointLocator:
        """Finds points in the quadratic mesh."""
        return PointLocator(self.quadratic_mesh)

    @cached_property
    def field_index(self) -> FieldIndex:
        """The solved states and the warnings of the simulation."""
        return load_index(self.folder)

    @cached_property
    def fields(self) -> Fields:
        """Displacements and strains of all states, with the printed traces in the body."""
        return load_fields(self.folder, has_traces=True)

    @cached_property
    def travel(self) -> float:
        """Largest movement of the surface in all states, mm."""
        skin = np.unique(self.mesh.boundary().faces)
        moved = self.fields.displacements[:, skin]
        return float(np.linalg.norm(moved, axis=2).max(initial=0.0))

    @cached_property
    def size(self) -> float:
        """Longest side of the body along the axes of its file, mm."""
        return float(np.ptp(self.surface.bounds, axis=0).max())

    @cached_property
    def plain_fields(self) -> Fields:
        """Displacements and strains of all states, without traces."""
        return load_fields(self.folder)

    @cached_property
    def forces(self) -> ForcesRecord:
        """The forces that hold the device in its poses."""
        return load_forces(self.folder)

    @cached_property
    def layout(self) -> LayoutRecord:
        """The cords and the errors predicted for them."""
        return load_layout(self.folder)

    @cached_property
    def prediction(self) -> PredictionRecord:
        """Signals and errors of the layout in every state."""
        return load_prediction(self.folder)

    @cached_property
    def weighed(self) -> WeighedCords:
        """The cords of all layouts that the layout was chosen from."""
        return load_weighed(self.folder)

    @cached_property
    def manifest(self) -> Manifest:
        """The printable parts, the cut list and the steps of assembly."""
        return load_manifest(self.folder)

    @property
    def has_parts(self) -> bool:
        """Whether the build has printable parts."""
        return (self.folder / MANIFEST).exists()

    @property
    def reference_resistors(self) -> tuple[float, ...]:
        """The dividers' resistors in the assembly guide, in the order of the channels, ohm."""
        try:
            manifest = self.manifest
        except StorageError as error:
            error.action = f"{error.action}, or give the values of the resistors as reference"
            raise
        proposed = {c.sensor: c.reference_resistor for c in manifest.cords}
        return tuple(proposed[cord.name] for cord in self.layout.by_channel())

    def describe_resistors(self) -> str:
        """Return the dividers' resistors in the assembly guide as a note."""
        names = [cord.name for cord in self.layout.by_channel()]
        values = ", ".join(
            f"{ohm:g} ohm ({name})"
            for name, ohm in zip(names, self.reference_resistors, strict=True)
        )
        return (
            f"the reference resistors are assumed to be those of the assembly guide: {values}."
            " Give their values as reference if yours are others"
        )

    @cached_property
    def parts(self) -> dict[str, Surface]:
        """The parts' surfaces as assembled, mm, rest frame, by name."""
        return load_parts(self.folder, self.manifest)
