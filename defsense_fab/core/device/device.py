"""A device: the content of `device.toml` as frozen records. Lengths in mm, angles in radians."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..arrays import Float
from ..curve import REST_FRAME, Hermite, Plane
from ..response import MeasuredResponse, ResponseSpec
from .filaments import TraceSpec
from .pads import PadSpec
from .prices import Prices
from .regions import Shape

BodyKind = Literal["script", "step", "mesh"]


@dataclass(frozen=True)
class BaySpec:
    """Connector bay.

    Attributes:
        at: Point (3,) of the skin around which the bay opens, mm.
        size: Width, height and depth, mm.
    """

    at: Float
    size: tuple[float, float, float]


@dataclass(frozen=True)
class BodySpec:
    """Source of the body.

    Attributes:
        kind: Kind of source.
        path: File of the source.
        parameters: Parameters of a script.
        scale: Factor from a mesh's unit to mm.
        bay: Connector bay that is cut into the body.
        time_limit: Limit for running a script or reading a file, s.
        fill_cavities: Whether enclosed cavities are filled.
    """

    kind: BodyKind
    path: Path
    parameters: Mapping[str, float | int | str | bool] = field(default_factory=dict)
    scale: float = 1.0
    bay: BaySpec | None = None
    time_limit: float = 600.0
    fill_cavities: bool = False


@dataclass(frozen=True)
class MaterialSpec:
    """Isotropic soft material.

    Attributes:
        name: Name of the material.
        young_modulus: Young's modulus at small strain, MPa.
        poisson_ratio: Poisson's ratio, below 0.5.
        model: Name of the hyperelastic model.
        density: Density, g/cm^3.
        constants: Constants of the model that Young's modulus does not determine, MPa.
    """

    name: str
    young_modulus: float
    poisson_ratio: float
    model: str = "neo-hookean"
    density: float = 1.1
    constants: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class MeshSpec:
    """Requirements on the tetrahedral mesh.

    Attributes:
        edge_length: Edge length of the tetrahedra, mm; None where `accuracy` determines it.
        accuracy: Relative accuracy of the signals.
        time_limit: Limit for the mesher, s.
    """

    edge_length: float | None = None
    accuracy: float | None = None
    time_limit: float = 3600.0


@dataclass(frozen=True)
class Handle:
    """Region that is moved rigidly.

    Attributes:
        region: Name of the region.
        rotation: Rotation vector (3,), rad.
        translation: Translation (3,), mm; NaN in components that the solver determines, where the
            resultant force is zero.
        free_axes: Axes (f, 3) about which the solver rotates the region: none, one (a hinge) or
            all three.
        about: Pivot (3,), mm; None for the region's center.
    """

    region: str
    rotation: Float
    translation: Float
    free_axes: Float = field(default_factory=lambda: np.zeros((0, 3)))
    about: Float | None = None


@dataclass(frozen=True)
class SymmetryPlane:
    """Region whose nodes stay in their plane.

    Attributes:
        region: Name of the region.
        normal: Unit normal (3,) of the plane.
    """

    region: str
    normal: Float


@dataclass(frozen=True)
class PointDrag:
    """Spring that pulls at a point.

    Attributes:
        at: The point (3,) at rest, mm.
        by: Displacement (3,) of the spring's other end, mm.
        stiffness: Stiffness, N/mm.
    """

    at: Float
    by: Float
    stiffness: float


@dataclass(frozen=True)
class RegionPressure:
    """Pressure on the body's surface in a region.

    Attributes:
        region: Name of the region.
        value: Pressure, MPa; positive pushes inward.
    """

    region: str
    value: float


@dataclass(frozen=True)
class Pose:
    """Fixed regions, handles and loads that together define one deformation.

    Attributes:
        name: Name of the pose.
        fixed: Names of the regions that stay in place.
        handles: Regions that move.
        symmetry: Regions that stay in their plane.
        drags: Springs that pull at points.
        pressures: Pressures on the surface.
        gravity: Gravity (3,), in multiples of standard gravity.
    """

    name: str
    fixed: tuple[str, ...]
    handles: tuple[Handle, ...]
    symmetry: tuple[SymmetryPlane, ...] = ()
    drags: tuple[PointDrag, ...] = ()
    pressures: tuple[RegionPressure, ...] = ()
    gravity: Float = field(default_factory=lambda: np.zeros(3))

    @property
    def has_loads(self) -> bool:
        """Whether drags, pressures or gravity act."""
        return bool(self.drags or self.pressures or np.any(self.gravity))


@dataclass(frozen=True)
class StatesSpec:
    """States that are simulated: fractions of each pose, and weighted mixtures of poses.

    Attributes:
        ramp: Fractions of each pose.
        mixtures: Weights of the poses in each mixture.
        held_out: The same for states that are only used to evaluate a design.
        mixtures_given: Whether the user gave the mixtures. Others are proposed, and those that
            cannot be solved are left out.
        held_out_given: The same for the states held out.
    """

    ramp: tuple[float, ...] = (1.0,)
    mixtures: tuple[Mapping[str, float], ...] = ()
    held_out: tuple[Mapping[str, float], ...] = ()
    mixtures_given: bool = True
    held_out_given: bool = True


@dataclass(frozen=True)
class OutputsSpec:
    """Positions that the device reports.

    Attributes:
        markers: Number of markers to distribute, explicit points (n, 3) in mm, or the whole
            surface.
        anchor: Region that stays in place during recordings, to which recorded markers are aligned.
    """

    markers: int | Float | Literal["surface"]
    anchor: str | None = None


#: Assumed behavior of a compressed cord whose response was measured in tension: the factor of its
#: slope below zero strain.
COMPRESSION_FACTORS = {"same": 1.0, "half": 0.5, "none": 0.0, "rising": -1.0}


@dataclass(frozen=True)
class CordSpec:
    """Piezoresistive cord.

    Attributes:
        name: Name of the cord.
        diameter: Diameter, mm.
        ohm_per_mm: Resistance per length at rest, ohm/mm.
        response: Response of the resistance to strain.
        max_strain: Largest strain that the cord withstands.
        min_bend_radius: Smallest radius of curvature, mm.
        noise: Standard deviation of (R - R0)/R0, whatever the cord's length.
        lengths: Smallest and largest length of a piece, free ends included, mm.
        ferrule_diameter: Outer diameter of the ferrule that joins cord and wire, mm.
        ferrule_length: Length of the ferrule, mm.
        contact: Standard deviation of the resistance of each joint with a wire, ohm.
        min_stretch: Smallest length between a piece's ends that is stretched, mm.
        modulus: Young's modulus, MPa.
        compression: Assumed behavior below zero strain, a key of `COMPRESSION_FACTORS`, or
            "measured".
        measured: Uncertainty of a response that was measured.
        trace: The printed traces that take the cords' place; None for cords.
    """

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
    trace: TraceSpec | None = None

    @property
    def noun(self) -> str:
        """What texts call one sensor: "cord" or "trace"."""
        return "cord" if self.trace is None else "trace"


#: A cord slides in its channel between ends that hold it, or is glued along its whole length.
ASSEMBLIES = ("held", "bonded")
#: Parts are printed, or cast in molds that are printed.
PROCESS_KINDS = ("print", "cast")


@dataclass(frozen=True)
class FabricationSpec:
    """How the device is made.

    Attributes:
        process: Name of the process.
        clearance: Clearance of a cord in its channel, on the diameter, mm.
        wall: Smallest wall thickness, mm.
        lead: Free cord at each end, mm.
        bed: Size of the print bed, mm.
        pockets: Whether joints of cord and wire get pockets in the body.
        limit_cuts: Whether a cut is limited to the area that its cords need.
        strain_relief: Whether wires leave by a bend; None where that costs little accuracy.
        wire_diameter: Diameter of the wires, mm.
        marker_seats: Number of flats for tags.
        marker_size: Size of the tags, mm.
        assembly: How cords are assembled, a name in `ASSEMBLIES`.
        prestretch: Share by which a held cord is stretched in assembly; None: as much as it needs.
        kind: Kind of process, a name in `PROCESS_KINDS`.
        line: Width of the printer's lines, mm.
        layer: Height of the printer's layers, mm.
        hole: Smallest hole that stays open, mm.
        spacing: Distance of parts on the print bed, mm.
        copies: Copies of the device on the plates.
        mould_wall: Wall thickness of molds, mm.
        shrinkage: Linear shrinkage of the cast material; None for that of the silicone's row.
        up: Unit direction that points up as a body with printed traces is printed.
        keep_whole: Names of regions that no joint and no channel may cross.
        rate: Volume that the printer extrudes, mm^3/s; None if its time is not estimated.
    """

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
    copies: int = 1
    mould_wall: float = 5.0
    shrinkage: float | None = None
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    keep_whole: tuple[str, ...] = ()
    rate: float | None = None


#: Freedoms of a cord's plane: position and direction, or position only.
PLANE_FREEDOMS = frozenset({"plane", "offset"})
#: Freedoms of a sensor, which the optimizer may use.
FREEDOMS = ("path", "plane", "offset", "ends")


@dataclass(frozen=True)
class Sensor:
    """One cord or trace in the device.

    Attributes:
        name: Name of the sensor.
        plane: Plane of its path; the rest frame for a path in space.
        curve: Path in the plane, or in space.
        free: Freedoms that the optimizer may use, names in `FREEDOMS`: "plane" and "offset" for
            planar paths, "ends" for paths in space.
    """

    name: str
    plane: Plane
    curve: Hermite
    free: frozenset[str] = frozenset()

    def in_space(self) -> Sensor:
        """Return the sensor with its path in space; where its plane was free its ends are."""
        points, tangents = (
            self.plane.to_world(self.curve.points),
            self.plane.turn(self.curve.tangents),
        )
        free = self.free
        if (free and self.curve.is_planar) or not free.isdisjoint(PLANE_FREEDOMS):
            free = frozenset({"path", "ends"})
        return replace(self, plane=REST_FRAME, curve=Hermite(points, tangents), free=free)


#: Kinds of maps from readings to positions; see `decoding/decoders.py`.
DECODERS = ("affine", "quadratic", "kernel")
#: Preference among layouts of similar quality.
PREFERENCES = ("simple", "accuracy")


@dataclass(frozen=True)
class Device:
    """Everything that a build needs to know.

    Attributes:
        name: Name of the device.
        source: Folder of `device.toml`.
        body: Source of the body.
        material: Material of the body.
        mesh: Requirements on the mesh.
        regions: Shapes of the named regions.
        poses: Poses that the device must sense.
        states: States that are simulated.
        outputs: Positions that the device reports.
        cord: The cord.
        fabrication: How the device is made.
        sensors: Cords that the user has drawn.
        propose: Number of cords to find in addition to those.
        planes: Largest number of planes of the cords; None for no limit.
        decoder: Map from readings to positions, a name in `DECODERS`, or "auto".
        prefer: Preference among layouts of similar quality, a name in `PREFERENCES`.
        converter: Converter that reads the cords, a name in `CONVERTERS`.
        board: Board that the cords are connected to, a name in `data/boards.csv`.
        seed: Seed of the random choices of the search for cords.
        searches: Largest number of searches; None for the number that the cords need.
        exits: Names of the regions in which wires leave the body; empty for anywhere.
        pad: Pads of printed traces; None for cords.
        prices: Prices that the user gives.
        parts: Number of parts of the layout to take; None for the fewest with a small error.
    """

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
    board: str = "nano"
    seed: int = 1
    searches: int | None = None
    exits: tuple[str, ...] = ()
    pad: PadSpec | None = None
    prices: Prices = field(default_factory=Prices)
    parts: int | None = None

    @property
    def simulated_material(self) -> MaterialSpec:
        """The material of the simulation, with a Young's modulus of 1 MPa where that is the same.

        Without loads, displacements depend on ratios of moduli only, and not on the density.
        """
        changed: dict[str, Any] = {"name": ""}
        if not any(p.has_loads for p in self.poses):
            changed["density"] = MaterialSpec.density
            if not self.material.constants:
                changed["young_modulus"] = 1.0
        return replace(self.material, **changed)

    @property
    def channel_diameter(self) -> float:
        """Diameter of the groove pair, or of the circle around a printed trace, mm."""
        if self.cord.trace is not None:
            return self.cord.diameter
        return self.cord.diameter + self.fabrication.clearance
