"""All assumptions of a device's twin, by traits that can be disabled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from ...core.device.device import Device
from ...core.errors import CaptureError, DeviceError
from ..electronics.readout_board import BoardTraits
from ..electronics.rubber_cords import CORD_FAMILIES, RubberTraits
from ..filming.camera_kinds import CAMERA_KINDS
from ..options import TWIN, TwinCameras, TwinOptions
from ..scenes.assumptions import Assumption, assume, disable_traits, list_assumptions
from ..scenes.hand_walk import WalkTraits
from ..scenes.marker_measurement import MarkerTraits
from .built_unit import BuildingTraits
from .device_fields import MechanicsTraits

#: Traits that cannot be disabled; their numbers can be changed.
PERMANENT_TRAITS = ("read-out board", "cameras", "hand", "time")


@dataclass(frozen=True)
class FilmTraits:
    """Assumptions on the cameras that film a twin.

    Attributes:
        kind: Kind of the cameras, a key of `CAMERA_KINDS`.
        count: Number of cameras.
        rate: Frame rate, Hz.
        focal: Standard deviation of the error of calibrated focal lengths, relative.
        center: Standard deviation of the error of calibrated principal points, px.
        turn: Standard deviation of the error of calibrated orientations, degrees.
        shift: Standard deviation of the error of calibrated positions, mm.
        steady: Extent of the sway of the hand, mm and degrees.

    Raises:
        CaptureError: There is no such kind of cameras (`unknown-camera-kind`).
    """

    kind: str = TwinCameras.kind
    count: int = TwinCameras.count
    rate: float = assume(15.0, "cameras", "Hz", "frame rate", off=15.0)
    focal: float = assume(
        5e-4,
        "calibration",
        "1",
        "error of the focal lengths, standard deviation",
        "the twin's own boards, calibrated (docs/cameras.md)",
    )
    center: float = assume(
        1.0, "calibration", "px", "error of the principal points, standard deviation"
    )
    turn: float = assume(
        0.02, "calibration", "degrees", "error of the orientations, standard deviation"
    )
    shift: float = assume(0.2, "calibration", "mm", "error of the positions, standard deviation")
    steady: float = assume(
        3.0, "cameras", "mm and degrees", "sway of the hand that holds the device", off=3.0
    )

    def __post_init__(self) -> None:
        if self.kind not in CAMERA_KINDS:
            raise CaptureError(
                f"there is no kind of cameras {self.kind!r}",
                code="unknown-camera-kind",
                where="twin",
                action=f"Use one of {', '.join(CAMERA_KINDS)}",
                camera_kind=self.kind,
            )


@dataclass(frozen=True)
class TwinTraits:
    """All assumptions of a twin.

    Attributes:
        mechanics: How the device is simulated.
        building: Tolerances of its maker.
        rubber: Properties of its cords.
        board: Properties of its read-out board.
        hand: How the hand moves.
        markers: How cameras measure markers, if no film is rendered.
        film: The cameras that film the device; None for measured markers.
        age: Age of the device at its first session, days.
        between: Time between sessions, h.
    """

    mechanics: MechanicsTraits = field(default_factory=MechanicsTraits)
    building: BuildingTraits = field(default_factory=BuildingTraits)
    rubber: RubberTraits = field(default_factory=RubberTraits)
    board: BoardTraits = field(default_factory=BoardTraits)
    hand: WalkTraits = field(default_factory=WalkTraits)
    markers: MarkerTraits = field(default_factory=MarkerTraits)
    film: FilmTraits | None = None
    age: float = assume(3.0, "time", "days", "age of the device at its first session")
    between: float = assume(20.0, "time", "h", "time between sessions")

    @classmethod
    def for_device(cls, device: Device, options: TwinOptions | None = None) -> TwinTraits:
        """Return the traits with the noise and the joints of the device's cords or printed traces.

        Printed traces also have the filament's differences between prints.

        Args:
            device: The device.
            options: Options of simulated sessions, whose cords, wrong markers and cameras are used.

        Raises:
            DeviceError: The cameras of the options are invalid, or have a seed of their own
                (`options-conflict`).
        """
        cord, options = device.cord, options or TwinOptions()
        markers, film = MarkerTraits(), None
        if options.wrong is not None:
            markers = replace(markers, wrong=options.wrong)
        if options.cameras:
            if "seed" in options.cameras:
                raise DeviceError(
                    f"{options.cameras} contains a seed",
                    code="options-conflict",
                    where="cameras",
                    action="Give the seed of the session instead",
                )
            cameras = TwinCameras.parse(f"{TWIN}:{options.cameras}")
            film = FilmTraits(cameras.kind, cameras.count, options.rate)
        memory = CORD_FAMILIES[options.family(device)]()
        rubber = RubberTraits(memory, noise=cord.noise, contact=cord.contact)
        building = BuildingTraits()
        if cord.trace is not None:
            building = replace(building, gauge=cord.trace.spread)
            rubber = replace(rubber, ohm_spread=cord.trace.spread)
        return cls(building=building, rubber=rubber, markers=markers, film=film)

    @property
    def assumptions(self) -> list[Assumption]:
        """Every assumed number with its source."""
        return list_assumptions(self, skip="" if self.film is None else "markers")

    @property
    def names(self) -> list[str]:
        """Names of the traits that can be disabled."""
        traits = (a.trait for a in self.assumptions if a.trait not in PERMANENT_TRAITS)
        return list(dict.fromkeys(traits))

    def disable_traits(self, names: Sequence[str]) -> TwinTraits:
        """Return the assumptions with some traits disabled.

        Raises:
            CaptureError: There is no such trait (`unknown-trait`).
        """
        for name in names:
            if name not in self.names:
                raise CaptureError(
                    f"there is no trait {name!r} to disable",
                    code="unknown-trait",
                    where="twin",
                    action=f"Use one of {', '.join(self.names)}",
                    trait=name,
                )
        return disable_traits(self, names)
