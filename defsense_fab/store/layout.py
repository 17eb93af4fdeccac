"""Results of the stage "optimize": the cords and the errors predicted for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from ..core.arrays import Float
from ..core.curve import Hermite, Plane
from ..core.device.build_folder import BUILD_AGAIN
from ..core.device.device import Sensor
from ..core.errors import DefsenseError, StorageError
from ..core.response import MeasuredResponse
from ..core.storage import typed_json
from ..core.storage.files import digest, load_json, write_json
from ..sensing.built_cord import BuiltCord
from .printed_pieces import PrintedPiece

LAYOUT, PREDICTION, LAYOUTS = "layout.json", "prediction.json", "layouts.json"


@dataclass(frozen=True)
class Prediction:
    """Predicted marker errors of a layout, as in `layout.json`.

    Attributes:
        decoder: Kind of the decoder.
        noise: Standard deviation of (R - R0)/R0 of each cord.
        unseen: RMSE on states that the decoder was not trained on, mm.
        unseen_noise_free: The same without the noise of the readings, mm.
        tested: Number of those states.
        how: How those states were chosen; see `decoding/expected_errors.py`.
        rmse: RMSE on the states that the decoder was trained on, mm.
        rmse_noise_free: The same without the noise of the readings, mm.
        peak: Largest error on those states, mm.
        average_peak: Mean over those states of the largest error, mm.
        floor: Lowest noise-free RMSE over all states that any layout with as many cords can reach
            with an affine map, mm.
        per_state: RMSE of each trained state, noise included, mm.
        held_out: RMSE of each held-out state, noise included, mm.
    """

    decoder: str
    noise: tuple[float, ...]
    unseen: float
    unseen_noise_free: float
    tested: int
    how: str
    rmse: float
    rmse_noise_free: float
    peak: float
    average_peak: float
    floor: float
    per_state: Mapping[str, float]
    held_out: Mapping[str, float]


@dataclass(frozen=True)
class WeighedCords:
    """The content of `layouts.json`.

    Attributes:
        layouts: The cords of each layout that the final one was chosen from, in the order of
            `LayoutRecord.weighed`.
    """

    SCHEMA: ClassVar[int] = 1

    layouts: tuple[tuple[CordPath, ...], ...]


def save_weighed(folder: Path, record: WeighedCords) -> None:
    """Write `layouts.json` into a build's folder. Raises StorageError."""
    typed_json.save(folder / LAYOUTS, record)


def load_weighed(folder: Path) -> WeighedCords:
    """Return the content of `layouts.json` of a build. Raises StorageError."""
    return typed_json.load(folder / LAYOUTS, WeighedCords, BUILD_AGAIN)


@dataclass(frozen=True)
class PlaneRecord:
    """The plane of a cord, in the rest frame.

    Attributes:
        origin: A point of the plane (3,), mm.
        normal: Unit normal (3,).
        x_axis: Unit vector (3,) along the plane's first axis.
    """

    origin: Float
    normal: Float
    x_axis: Float


@dataclass(frozen=True)
class CordPath:
    """The path of a cord.

    Attributes:
        name: Name of the cord.
        plane: The plane of the path.
        control_points: Points (k, 2) of the Hermite spline in the plane, mm.
        tangents: Tangents (k, 2) at the points, mm.
    """

    name: str
    plane: PlaneRecord
    control_points: Float
    tangents: Float

    @staticmethod
    def of(sensor: Sensor) -> CordPath:
        """Return the path of a cord."""
        plane = PlaneRecord(sensor.plane.origin, sensor.plane.normal, sensor.plane.axes[:, 0])
        return CordPath(sensor.name, plane, sensor.curve.points, sensor.curve.tangents)

    def sensor(self) -> Sensor:
        """Return the cord, with nothing left for the optimizer to change."""
        plane = Plane.from_normal(self.plane.origin, self.plane.normal, self.plane.x_axis)
        return Sensor(self.name, plane, Hermite(self.control_points, self.tangents))


@dataclass(frozen=True)
class CordRecord(CordPath):
    """A cord as it was optimized and as it is built in.

    Attributes:
        channel: Its channel of the read-out board.
        points: Its path (p, 3), p >= 100, mm, rest frame.
        length: Length from skin to skin, mm.
        min_radius: Smallest radius of curvature, mm.
        min_wall: Smallest distance to the skin, mm.
        inlets: Lengths of the straight runs to the skin at both ends, mm.
        cord_diameter: Diameter, mm.
        peak_strain: Largest strain over all states.
        least_strain: Smallest strain over all states.
        stretch: The part of the path (q, 3) that is stretched, mm, rest frame.
        series: Length of cord that conducts in series with it, mm.
        prestretch: Strain at rest; None for a bonded cord.
        noise: Standard deviation of (R - R0)/R0.
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
        """The cord as it is built in, for predictions."""
        return BuiltCord(self.stretch, self.series, self.prestretch)


@dataclass(frozen=True)
class LimitsRecord:
    """Limits that the cords keep.

    Attributes:
        wall: Smallest distance to the skin, mm.
        min_radius: Smallest radius of curvature, mm.
        clearance: Smallest distance between cords, mm.
    """

    wall: float
    min_radius: float
    clearance: float


@dataclass(frozen=True)
class ErrorRange:
    """RMSE of built devices on unseen states.

    Attributes:
        median: Median, mm.
        low: Lower limit of the range of 90 % of the devices, mm.
        high: Upper limit of this range, mm.
    """

    median: float
    low: float
    high: float


@dataclass(frozen=True)
class BandRecord:
    """The errors of built devices on unseen states, with the tolerances they were drawn with.

    `optimization/studies/tolerance_monte_carlo.py` describes the tolerances,
    `sensing/memory_residual.py` the memory of the cords.

    Attributes:
        median: Median RMSE by noise and tolerances alone, mm.
        low: Lower limit of the range of 90 % of the devices, mm.
        high: Upper limit of this range, mm.
        trained: RMSE expected in a session after training, with the memory of the cords. The
            median is of the cord's kind of memory if it is known; the range is always of all kinds.
        families: The same for each kind of memory.
        affine: The same with the paper's affine decoder, which has no memory.
        offset: Largest distance of a cord from its groove's axis, mm.
        gauge: Relative standard deviation of the cords' gauge factors.
        amplitude: Relative standard deviation of the poses' amplitudes.
        ends: Standard deviation of a held cord's loose length between its ends, mm.
        compression: Largest share of its slope that a response may lack below zero strain.
        frames: Number of frames of the test.
        family: The cord's kind of memory; empty if it is not known.
        without_memory: Median RMSE in a session by noise and tolerances alone, mm; None if that of
            unseen states is meant.
        resistance: Relative standard deviation of the traces' resistances at rest; zero for cords.
    """

    median: float
    low: float
    high: float
    trained: ErrorRange
    families: Mapping[str, ErrorRange]
    affine: ErrorRange
    offset: float
    gauge: float
    amplitude: float
    ends: float
    compression: float
    frames: int
    family: str = ""
    without_memory: float | None = None
    resistance: float = 0.0

    @property
    def noise_part(self) -> float:
        """RMSE (mm) that noise and tolerances cause of the one expected after training."""
        return self.median if self.without_memory is None else self.without_memory

    def describe_trained(self, noun: str = "cord") -> str:
        """Return the expected error as a sentence without its period.

        Args:
            noun: What the text calls a sensor, "cord" or "trace".
        """
        t, cords = self.trained, f" on {self.family} {noun}s" if self.family else ""
        return (
            f"{t.median:.2f} mm expected after training{cords} ({t.low:.2f} to {t.high:.2f} in 90"
            f" of 100 devices); {self.noise_part:.2f} mm of it from noise and tolerances"
        )

    def compare_measured(self, measured: float, family: str = "") -> str:
        """Return how a measured error compares with the expected one, as sentences.

        Args:
            measured: The measured RMSE, mm.
            family: Kind of memory of the cords, of a twin's; empty if it is not known.
        """
        t, text = self.trained, self.describe_trained()
        if family in self.families:
            t = self.families[family]
            text = (
                f"{t.median:.2f} mm expected after training on {family} cords ({t.low:.2f} to"
                f" {t.high:.2f} in 90 of 100 devices)"
            )
        position = "inside" if t.low <= measured <= t.high else "outside"
        return (
            f"From the design: {text}. Measured: {measured:.2f} mm, {position} this range;"
            f" expected / measured {t.median / measured:.2f}."
        )


@dataclass(frozen=True)
class WeighedRecord:
    """A layout that was compared with others.

    Attributes:
        designed: RMSE on unseen states as designed, mm.
        built: RMSE on unseen states as built, mm; None if it cannot be made.
        planes: Number of cord planes.
        slanted: Number of plane directions that are not those of flat faces.
        parts: Number of parts; None if they were not made.
        smallest: Volume of the smallest part, mm^3.
        free_ends: Number of ends of cords that no pocket holds.
        warnings: What is doubtful about the parts.
        problem: Why it cannot be made, if it cannot.
        chosen: Whether it was chosen.
        pieces: The parts and pins of one device as they are printed; empty if not made.
    """

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
    pieces: tuple[PrintedPiece, ...] = ()


@dataclass(frozen=True)
class LayoutRecord:
    """The content of `layout.json`.

    Attributes:
        device: Name of the device.
        mesh: Hash of the mesh that the layout was designed on.
        limits: Limits that the cords keep.
        response: The measured response of the cords, if there is one.
        sensors: The cords.
        min_clearance: Smallest distance between cords, mm; None for a single cord.
        warnings: What is doubtful about the layout.
        weighed: The layouts that it was chosen from.
        prediction: The predicted errors.
        unseen: RMSE on unseen states by decoder, mm.
        cross_validated: RMSE by decoder, each state that was designed for left out of the
            decoder's training in turn, mm.
        band: The errors of built devices.
        initial: The prediction for the paths that the search started from.
        drawn: The drawn or first proposed paths (p, 3), mm, rest frame.
        proposed: Whether the search started from paths that it proposed itself.
        starts: RMSE of the searches' starting layouts, mm.
        seed: Seed of the searches.
        warned_cords: Name of the cord that a warning is about, by the warning.
        continued: "kept" or "improved" if the layout of an earlier build was, without a search;
            empty after a search.
        repaired: Names of drawn cords that break a limit, and were repaired for `initial`.
    """

    SCHEMA: ClassVar[int] = 6

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
    warned_cords: Mapping[str, str] = field(default_factory=dict)
    continued: str = ""
    repaired: tuple[str, ...] = ()

    @property
    def initial_label(self) -> str:
        """How the cords of `initial` came about, for headings."""
        if self.proposed:
            return "as proposed"
        return "as drawn, repaired" if self.repaired else "as drawn"

    @property
    def middles(self) -> dict[str, Float]:
        """Point (3,) mm in the middle of each cord, by its name."""
        return {s.name: s.points[len(s.points) // 2] for s in self.sensors}

    def by_channel(self) -> list[CordRecord]:
        """Return the cords in the order of their channels."""
        return sorted(self.sensors, key=lambda s: s.channel)


@dataclass(frozen=True)
class PredictionRecord:
    """The content of `prediction.json`.

    Attributes:
        markers: Markers (k, 3) at rest, mm.
        states: Names of the n states, rest first.
        signals: Signals (n, c) in each state.
        errors: Errors (n, k) of the markers without noise, mm.
        decoder: The decoder's numbers.
    """

    SCHEMA: ClassVar[int] = 1

    markers: Float
    states: tuple[str, ...]
    signals: Float
    errors: Float
    decoder: Mapping[str, Any]


def layout_hash(layout: LayoutRecord) -> str:
    """Return a hash of the cords' paths, channels and diameters.

    It does not depend on what is predicted for the cords.
    """
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
    """Write `layout.json` and `prediction.json`. Raises StorageError."""
    typed_json.save(folder / LAYOUT, layout)
    typed_json.save(folder / PREDICTION, prediction)


def name_layout(folder: Path, device: str) -> None:
    """Change the device's name in `layout.json`, if it differs. Raises StorageError."""
    layout = load_json(folder / LAYOUT, StorageError, BUILD_AGAIN)
    if layout.get("device") != device:
        write_json(folder / LAYOUT, layout | {"device": device})


def load_layout(folder: Path, error: type[DefsenseError] = StorageError) -> LayoutRecord:
    """Return the layout of a build. Raises `error`."""
    return typed_json.load(folder / LAYOUT, LayoutRecord, BUILD_AGAIN, error)


def load_prediction(folder: Path) -> PredictionRecord:
    """Return the prediction of a build's layout. Raises StorageError."""
    return typed_json.load(folder / PREDICTION, PredictionRecord, BUILD_AGAIN)
