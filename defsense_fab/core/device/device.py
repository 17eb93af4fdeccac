"""The device: what `device.toml` says, as frozen records. Lengths in mm, angles in radians."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from ..arrays import Float
from ..curve import Hermite, Plane
from ..response import MeasuredResponse, ResponseSpec
from .regions import Shape

BodyKind = Literal["script", "step", "mesh"]


@dataclass(frozen=True)
class BaySpec:
    """A connector bay: the point `at` (3,) mm of the skin around which it opens, and its width,
    height and depth, mm."""

    at: Float
    size: tuple[float, float, float]


@dataclass(frozen=True)
class BodySpec:
    """Where the body comes from; `scale` turns a mesh's unit into mm; the connector `bay` that is
    cut into it; `time_limit` of a script or of reading a file, s; whether cavities are to be
    filled."""

    kind: BodyKind
    path: Path
    parameters: Mapping[str, float | int | str | bool] = field(default_factory=dict)
    scale: float = 1.0
    bay: BaySpec | None = None
    time_limit: float = 600.0
    fill_cavities: bool = False


@dataclass(frozen=True)
class MaterialSpec:
    """Isotropic soft material: Young's modulus in MPa at small strain, Poisson's ratio below 0.5,
    density in g/cm^3; `constants` (MPa) of the hyperelastic `model` where E does not give them."""

    name: str
    young_modulus: float
    poisson_ratio: float
    model: str = "neo-hookean"
    density: float = 1.1
    constants: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class MeshSpec:
    """Edge length of the tets in mm, or the relative `accuracy` of signals that chooses it;
    `time_limit` of the mesher, s."""

    edge_length: float | None = None
    accuracy: float | None = None
    time_limit: float = 3600.0


@dataclass(frozen=True)
class Handle:
    """A region moved rigidly: rotation vector (3,) rad about the point `about` (3,) mm, or the
    region's centre.

    `translation` (3,) mm has NaN where the solver finds it (zero resultant force). `free_axes`
    (f, 3) are the axes about which the solver turns it: none, one (a hinge) or all three.
    """

    region: str
    rotation: Float
    translation: Float
    free_axes: Float = field(default_factory=lambda: np.zeros((0, 3)))
    about: Float | None = None


@dataclass(frozen=True)
class SymmetryPlane:
    """A region whose nodes stay in their plane, with unit `normal` (3,)."""

    region: str
    normal: Float


@dataclass(frozen=True)
class PointDrag:
    """A spring of `stiffness` (N/mm) that pulls the point `at` (3,) mm by `by` (3,) mm."""

    at: Float
    by: Float
    stiffness: float


@dataclass(frozen=True)
class RegionPressure:
    """Pressure in MPa on the body's surface inside a region; positive pushes inwards."""

    region: str
    value: float


@dataclass(frozen=True)
class Pose:
    """Fixed regions, handles and loads that together define one deformation.

    `gravity` (3,) in multiples of standard gravity.
    """

    name: str
    fixed: tuple[str, ...]
    handles: tuple[Handle, ...]
    symmetry: tuple[SymmetryPlane, ...] = ()
    drags: tuple[PointDrag, ...] = ()
    pressures: tuple[RegionPressure, ...] = ()
    gravity: Float = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class StatesSpec:
    """Fractions of each pose, and weighted mixtures of poses; held-out ones are only scored. Where
    mixtures are not `given`, they are proposed, and those that cannot be solved are left out."""

    ramp: tuple[float, ...] = (1.0,)
    mixtures: tuple[Mapping[str, float], ...] = ()
    held_out: tuple[Mapping[str, float], ...] = ()
    given: bool = True


@dataclass(frozen=True)
class OutputsSpec:
    """`markers`: how many to spread, explicit points (n, 3), or the whole surface."""

    markers: int | Float | Literal["surface"]
    anchor: str | None = None


#: What becomes of a response that was measured in tension where its cord is compressed: the factor
#: of its slope below zero strain.
COMPRESSION = {"same": 1.0, "half": 0.5, "none": 0.0, "rising": -1.0}


@dataclass(frozen=True)
class CordSpec:
    """A piezoresistive cord; its `response` to strain, and what it is taken to do under
    `compression` where that was not measured (a name of COMPRESSION, or "measured"); what is known
    of the response where it was `measured`; `noise` is the
    standard deviation of (R - R0)/R0 however long the cord, `contact` that of the resistance of
    each joint with a wire, ohm; `lengths` the least and the greatest that a piece may have, free
    ends included, and `min_stretch` the least that is to lie between its ends and be stretched; the
    outside of the `ferrule` that joins it to a wire, mm; Young's `modulus`, MPa."""

    name: str
    diameter: float
    ohm_per_mm: float
    response: ResponseSpec
    max_strain: float
    min_bend_radius: float
    noise: float
    lengths: tuple[float, float] = (0.0, float("inf"))
    ferrule_diameter: float = 2.6
    ferrule_length: float = 7.0
    contact: float = 0.0
    min_stretch: float = 0.0
    modulus: float = 0.0
    compression: str = "same"
    measured: MeasuredResponse | None = None


#: What reads the resistances: full scale of a conversion in counts, and conversions a sample.
CONVERTERS = {"arduino": (1023, 16), "ads1115": (40000, 1)}
#: A cord slides in its channel between ends that hold it, or is glued into it all along.
ASSEMBLIES = ("held", "bonded")
#: Parts are printed, or cast in moulds that are printed.
PROCESS_KINDS = ("print", "cast")


@dataclass(frozen=True)
class FabricationSpec:
    """Printing process: channel clearance on the diameter, least wall, free cord at each end, mm;
    whether joints of cord and wire get `pockets` in the body, and cuts are limited (`limit_cuts`)
    to what their cords need; whether wires leave their pockets by a bend (`strain_relief`; None:
    where that costs little accuracy), and their `wire_diameter`; `marker_seats`, how many flats for
    tags of `marker_size` mm; the `assembly` of the cords (ASSEMBLIES), and by how much of its
    length a held one is stretched as it is laid (`prestretch`; None: as much as it needs).

    `kind` is "print" or "cast" in printed moulds, `line`, `layer` and `hole` what the printer lays
    and the least hole that stays open, `spacing` what parts keep on its bed, mm, `supports` whether
    parts need them: "no", "yes" or all "inside" of hollows; `copies` of the device on the plates;
    walls of moulds (`mould_wall`, mm), and the linear `shrinkage` of what is cast, where it is
    given (None: as the silicone's row has it)."""

    process: str
    clearance: float
    wall: float
    lead: float
    bed: tuple[float, float, float]
    pockets: bool = True
    limit_cuts: bool = False
    strain_relief: bool | None = None
    wire_diameter: float = 1.1
    marker_seats: int = 0
    marker_size: float = 10.0
    assembly: str = ASSEMBLIES[0]
    prestretch: float | None = None
    kind: str = PROCESS_KINDS[0]
    line: float = 0.4
    layer: float = 0.2
    hole: float = 0.0
    spacing: float = 5.0
    supports: str = "no"
    copies: int = 1
    mould_wall: float = 5.0
    shrinkage: float | None = None


#: What the optimiser may change of a cord's plane: where it lies and how it is turned, or where it
#: lies and not its direction.
PLANE_FREEDOMS = frozenset({"plane", "offset"})
#: What it may change of a cord.
FREEDOMS = ("path", "plane", "offset")


@dataclass(frozen=True)
class Sensor:
    """One cord: its plane, its path in the plane, and what the optimiser may change."""

    name: str
    plane: Plane
    curve: Hermite
    free: frozenset[str] = frozenset()


#: What the map from readings to positions may be; see `decoding/decoders.py`.
DECODERS = ("affine", "quadratic", "kernel")
#: What is preferred among layouts that are about as good.
PREFERENCES = ("simple", "accuracy")


@dataclass(frozen=True)
class Device:
    """All that a build needs to know; `source` is the folder of `device.toml`, `propose` the number
    of cords to find besides those drawn, `planes` the most planes that they may take, or None;
    among layouts that are about as good `prefer` takes the simplest one or the most accurate; the
    `converter` that reads the cords (CONVERTERS); the `seed` of the random choices of the search
    for cords, and the most `searches` that are made (None: as many as their number of cords asks
    for)."""

    name: str
    source: Path
    body: BodySpec
    material: MaterialSpec
    mesh: MeshSpec
    regions: Mapping[str, Shape]
    poses: tuple[Pose, ...]
    states: StatesSpec
    outputs: OutputsSpec
    cord: CordSpec
    fabrication: FabricationSpec
    sensors: tuple[Sensor, ...]
    propose: int
    planes: int | None
    decoder: str
    prefer: str = "simple"
    converter: str = "arduino"
    seed: int = 1
    searches: int | None = None

    @property
    def channel_diameter(self) -> float:
        """Diameter of the groove pair, mm."""
        return self.cord.diameter + self.fabrication.clearance
