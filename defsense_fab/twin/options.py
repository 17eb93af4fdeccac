"""Options of simulated training sessions and simulated cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal, get_args

from msgspec import Meta

from ..core.device.device import Device
from ..core.errors import CaptureError, DefsenseError, DeviceError
from ..core.schema.options import check_options

#: Name that stands for simulated cameras, or for a simulated read-out board.
TWIN = "twin"
#: Kinds of simulated cameras; `camera_kinds` has their properties.
CameraKindName = Literal["webcam", "phone", "industrial"]
#: Families of the cords' memory; `rubber_cords` has their properties.
CordFamilyName = Literal["viscoelastic", "hysteretic", "network"]
#: Families of the memory of cords and of printed traces that sessions have by default.
DEFAULT_CORDS: CordFamilyName = "viscoelastic"
DEFAULT_TRACES: CordFamilyName = "network"
_Seed = Annotated[int, Meta(ge=0, le=1_000_000_000)]


@dataclass(frozen=True)
class TwinOptions:
    """Options of the sessions that are simulated for training.

    Attributes:
        minutes: Set the duration of each session in minutes.
        sessions: Set the number of sessions of the same unit, 20 hours apart.
        seed: Set the random seed of the hand's path.
        unit: Choose the built unit, with its tolerances and pieces of cord.
        cords: Choose the family of the cords' memory: viscoelastic (assumed), hysteretic (fitted
            to recordings of knitted sensors), or network (fitted to readings of printed TPU
            sensors) (default: viscoelastic for cords, network for printed traces).
        off: Turn these traits off.
        wrong: Set the share of wrong marker positions (default: 0).
        grips: Set the number of places that are pulled in addition to the poses.
        cameras: Film the device with rendered cameras, webcam, phone or industrial (such as
            webcam,cameras=3), and process the session like a recorded one; takes some minutes per
            minute of the session (default: markers with noise, without pictures).
        rate: Set the frame rate of rendered cameras in Hz.
        markers: Use the tags of 'capture markers' instead of [outputs] markers; rendered cameras
            need them (default: markers, in the device folder).

    Raises:
        CaptureError: A number is out of range (`out-of-range`).
    """

    minutes: Annotated[float, Meta(ge=0.2, le=1440)] = 10.0
    sessions: Annotated[int, Meta(ge=1, le=100)] = 1
    seed: _Seed = 1
    unit: _Seed = 1
    cords: CordFamilyName | None = None
    off: tuple[str, ...] = ()
    wrong: Annotated[float, Meta(ge=0, le=0.5)] | None = None
    grips: Annotated[int, Meta(ge=0, le=4)] = 0
    cameras: str | None = None
    rate: Annotated[float, Meta(ge=5, le=60)] = 15.0
    markers: Path | None = None

    def __post_init__(self) -> None:
        check_options(self, CaptureError)

    def family(self, device: Device) -> CordFamilyName:
        """Return the family of the memory of a device's cords or printed traces."""
        default = DEFAULT_CORDS if device.cord.trace is None else DEFAULT_TRACES
        return self.cords or default


@dataclass(frozen=True)
class TwinCameras:
    """Simulated cameras.

    Attributes:
        seed: Set the seed of everything that is random.
        count: Set the number of cameras.
        kind: Choose the kind of the cameras.

    Raises:
        DeviceError: A value is out of range (`out-of-range`), or there is no such kind of cameras
            (`unknown-choice`).
    """

    seed: Annotated[int, Meta(ge=0)] = 1
    count: Annotated[int, Meta(ge=1, le=6)] = 2
    kind: CameraKindName = "webcam"

    def __post_init__(self) -> None:
        check_options(self)

    @classmethod
    def parse(cls, text: str, where: str = "cameras") -> TwinCameras:
        """Parse simulated cameras, such as `twin:webcam,seed=1,cameras=2`.

        Args:
            text: The words after `twin:` may come in any order; each may be omitted.
            where: Argument to name in an error.

        Raises:
            DeviceError: A word is not known (`twin-cameras-invalid`), or there are more than 6
                cameras (`out-of-range`).
        """
        cameras = cls()
        for word in filter(None, text.partition(":")[2].split(",")):
            name, equals, number = word.partition("=")
            field = {"seed": "seed", "cameras": "count"}.get(name)
            if not equals and name in get_args(CameraKindName):
                changes: dict[str, object] = {"kind": name}
            elif equals and field and number.isdecimal():
                changes = {field: int(number)}
            else:
                raise DeviceError(
                    f"{word!r} in {text} is not a setting of simulated cameras",
                    code="twin-cameras-invalid",
                    where=where,
                    action="Use twin:KIND,seed=1,cameras=2, where KIND is one of"
                    f" {', '.join(get_args(CameraKindName))}",
                    value=word,
                )
            try:
                cameras = replace(cameras, **changes)  # type: ignore[arg-type]
            except DefsenseError as error:
                error.where = f"{where}, {word}"
                raise
        return cameras


def is_twin(address: str) -> bool:
    """Return whether an address of a camera or a board stands for simulated ones."""
    return address.partition(":")[0] == TWIN
