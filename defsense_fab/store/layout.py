"""What the optimise stage leaves: the cords' paths (`layout.json`) and what they are predicted to
sense (in it, and in full in `prediction.json`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..core.arrays import Float
from ..core.curve import Hermite, Plane
from ..core.device.build_folder import BUILD_AGAIN
from ..core.device.device import Sensor
from ..core.errors import DefsenseError, StorageError
from ..core.prediction import Prediction
from ..core.response import MeasuredResponse
from ..core.storage import typed_json
from ..core.storage.files import digest, load_json, write_json
from ..sensing.built_cord import BuiltCord

# The cords of all layouts that the one of `layout.json` was chosen from (`layouts.json`).

LAYOUTS = "layouts.json"


@dataclass(frozen=True)
class WeighedCords:
    """Of each layout, in the order of `LayoutRecord.weighed`, its cords as they are drawn."""

    SCHEMA: ClassVar[int] = 1

    layouts: tuple[tuple[CordPath, ...], ...]


def save_weighed(folder: Path, record: WeighedCords) -> None:
    """Into a build's folder. Raises StorageError."""
    typed_json.save(folder / LAYOUTS, record)


def load_weighed(folder: Path) -> WeighedCords:
    """From a build's folder. Raises StorageError; builds of versions before this have none."""
    return typed_json.load(folder / LAYOUTS, WeighedCords, BUILD_AGAIN)


LAYOUT, PREDICTION = "layout.json", "prediction.json"


@dataclass(frozen=True)
class PlaneRecord:
    """Origin (3,) mm, unit normal and x axis (3,), rest frame."""

    origin: Float
    normal: Float
    x_axis: Float


@dataclass(frozen=True)
class CordPath:
    """A cord as it is drawn: control points and tangents (k, 2) mm in its plane."""

    name: str
    plane: PlaneRecord
    control_points: Float
    tangents: Float

    @staticmethod
    def of(sensor: Sensor) -> CordPath:
        plane = PlaneRecord(sensor.plane.origin, sensor.plane.normal, sensor.plane.axes[:, 0])
        return CordPath(sensor.name, plane, sensor.curve.points, sensor.curve.tangents)

    def sensor(self) -> Sensor:
        """The cord, locked where it is."""
        plane = Plane.from_normal(self.plane.origin, self.plane.normal, self.plane.x_axis)
        return Sensor(self.name, plane, Hermite(self.control_points, self.tangents))


@dataclass(frozen=True)
class CordRecord(CordPath):
    """A cord as it was optimised, and as it is built in.

    Optimised: its channel of the read-out; `points` (p >= 100, 3) mm of its path in the rest frame;
    length from skin to skin, least radius, least wall (mm); lengths (2,) mm of the straight runs to
    the skin. Built in: the strains between which it is stretched over all states; the `stretch`
    (q, 3) mm of its path on which it is, in the rest frame; the length in `series` with that, mm;
    by how much of its length it is stretched as it is laid (null: it is bonded); the standard
    deviation `noise` of its (R - R0)/R0.
    """

    channel: int
    points: Float
    length: float
    min_radius: float
    min_wall: float
    inlets: tuple[float, float]
    cord_diameter: float
    peak_strain: float
    least_strain: float
    stretch: Float
    series: float
    prestretch: float | None
    noise: float

    @property
    def built(self) -> BuiltCord:
        """The cord as it is built in."""
        return BuiltCord(self.stretch, self.series, self.prestretch)


@dataclass(frozen=True)
class LimitsRecord:
    """Least wall, radius of curvature and distance between cords, mm."""

    wall: float
    min_radius: float
    clearance: float


@dataclass(frozen=True)
class BandRecord:
    """RMSE (mm) of built devices on unseen states: median and the limits of 90 % of them, and the
    tolerances that they were drawn with (see optimize/studies/tolerance_monte_carlo.py)."""

    median: float
    low: float
    high: float
    offset: float
    gauge: float
    amplitude: float
    prestretch: float
    compression: float
    frames: int


@dataclass(frozen=True)
class WeighedRecord:
    """A layout that was made on trial: RMSE (mm) on unseen states as designed and as built, planes,
    the directions of these that are no flat face's, parts, the smallest one's volume (mm^3), ends
    of cords that no pocket holds, what is to be said of it, the problem for which it cannot be
    made; whether it is the one that was chosen."""

    designed: float
    built: float | None
    planes: int
    slanted: int
    parts: int | None
    smallest: float | None
    free_ends: int
    warnings: tuple[str, ...]
    problem: str | None
    chosen: bool


@dataclass(frozen=True)
class LayoutRecord:
    """`layout.json`. `mesh` is the hash of the mesh that it was designed on, `unseen` and
    `cross_validated` the RMSE (mm) of each decoder on unseen states, and on those designed for,
    left out of its training in turn, `response` what is known of the cords' response where it was
    measured, `weighed` the layouts that it was chosen from, `initial` the prediction for the paths
    as `drawn`, each (p, 3) mm."""

    SCHEMA: ClassVar[int] = 5

    device: str
    mesh: str
    limits: LimitsRecord
    response: MeasuredResponse | None
    sensors: tuple[CordRecord, ...]
    min_clearance: float | None
    warnings: tuple[str, ...]
    weighed: tuple[WeighedRecord, ...]
    prediction: Prediction
    unseen: Mapping[str, float]
    cross_validated: Mapping[str, float]
    band: BandRecord
    initial: Prediction
    drawn: tuple[Float, ...]
    proposed: bool
    starts: tuple[float, ...]
    seed: int

    def by_channel(self) -> list[CordRecord]:
        """The cords in the order of their channels."""
        return sorted(self.sensors, key=lambda s: s.channel)


@dataclass(frozen=True)
class PredictionRecord:
    """`prediction.json`: markers (k, 3) mm; of n states with rest first their names, signals (n, c)
    and errors (n, k) mm without noise; the numbers of the decoder."""

    SCHEMA: ClassVar[int] = 1

    markers: Float
    states: tuple[str, ...]
    signals: Float
    errors: Float
    decoder: Mapping[str, Any]


def layout_hash(layout: LayoutRecord) -> str:
    """Of where the cords run, by channel, and how thick they are: of the same cords it is the same,
    whatever else is predicted of them."""
    return digest(
        *(
            (
                c.name, c.channel, c.cord_diameter, c.plane.origin.tolist(),
                c.plane.normal.tolist(), c.plane.x_axis.tolist(), c.control_points.tolist(),
                c.tangents.tolist(),
            )
            for c in layout.by_channel()
        )
    )  # fmt: skip


def save_layout(folder: Path, layout: LayoutRecord, prediction: PredictionRecord) -> None:
    """Both files. Raises StorageError."""
    typed_json.save(folder / LAYOUT, layout)
    typed_json.save(folder / PREDICTION, prediction)


def name_layout(folder: Path, device: str) -> None:
    """Write the device's name into `layout.json`, if it is another one. Raises StorageError."""
    layout = load_json(folder / LAYOUT, StorageError, BUILD_AGAIN)
    if layout.get("device") != device:
        write_json(folder / LAYOUT, layout | {"device": device})


def load_layout(folder: Path, error: type[DefsenseError] = StorageError) -> LayoutRecord:
    """From a build's folder. Raises `error`."""
    return typed_json.load(folder / LAYOUT, LayoutRecord, BUILD_AGAIN, error)


def load_prediction(folder: Path) -> PredictionRecord:
    """From a build's folder. Raises StorageError."""
    return typed_json.load(folder / PREDICTION, PredictionRecord, BUILD_AGAIN)
