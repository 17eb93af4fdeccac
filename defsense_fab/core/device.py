"""The device: what `device.toml` says, as frozen records. Lengths in mm, angles in radians."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from .arrays import Float
from .curve import Hermite, Plane
from .regions import Shape

BodyKind = Literal["script", "step", "mesh"]


@dataclass(frozen=True)
class BodySpec:
    """Where the body comes from; `scale` turns a mesh's unit into mm."""

    kind: BodyKind
    path: Path
    parameters: Mapping[str, float | int | str | bool] = field(default_factory=dict)
    scale: float = 1.0


@dataclass(frozen=True)
class MaterialSpec:
    """Isotropic soft material: Young's modulus in MPa, Poisson's ratio below 0.5."""

    name: str
    young_modulus: float
    poisson_ratio: float


@dataclass(frozen=True)
class Handle:
    """A region moved rigidly: rotation vector (3,) rad about the region's centre.

    `translation` is (3,) mm, or None where the solver finds it (zero resultant force).
    """

    region: str
    rotation: Float
    translation: Float | None


@dataclass(frozen=True)
class Pose:
    """Fixed regions and handles that together define one deformation."""

    name: str
    fixed: tuple[str, ...]
    handles: tuple[Handle, ...]


@dataclass(frozen=True)
class StatesSpec:
    """Fractions of each pose, and weighted mixtures of poses; held-out ones are only scored."""

    ramp: tuple[float, ...] = (1.0,)
    mixtures: tuple[Mapping[str, float], ...] = ()
    held_out: tuple[Mapping[str, float], ...] = ()


@dataclass(frozen=True)
class OutputsSpec:
    """`markers`: how many to spread, explicit points (n, 3), or the whole surface."""

    markers: int | Float | Literal["surface"]
    anchor: str | None = None


@dataclass(frozen=True)
class CordSpec:
    """A piezoresistive cord; `noise` is the standard deviation of (R - R0)/R0."""

    name: str
    diameter: float
    ohm_per_mm: float
    gauge_factor: float
    max_strain: float
    min_bend_radius: float
    noise: float


@dataclass(frozen=True)
class FabricationSpec:
    """Printing process: channel clearance on the diameter, least wall, free cord at each end."""

    process: str
    clearance: float
    wall: float
    lead: float
    bed: tuple[float, float, float]


@dataclass(frozen=True)
class Sensor:
    """One cord: its plane, its path in the plane, and what the optimiser may change."""

    name: str
    plane: Plane
    curve: Hermite
    free: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Device:
    """All that a build needs to know; `source` is the folder of `device.toml`."""

    name: str
    source: Path
    body: BodySpec
    material: MaterialSpec
    edge_length: float
    regions: Mapping[str, Shape]
    poses: tuple[Pose, ...]
    states: StatesSpec
    outputs: OutputsSpec
    cord: CordSpec
    fabrication: FabricationSpec
    sensors: tuple[Sensor, ...]
    propose: int

    @property
    def channel_diameter(self) -> float:
        """Diameter of the groove pair, mm."""
        return self.cord.diameter + self.fabrication.clearance
