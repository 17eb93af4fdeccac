"""What is taken for granted of the cameras that film a twin."""

from __future__ import annotations

from dataclasses import dataclass

from ....core.errors import CaptureError
from ....twin.filming.camera_kinds import KINDS, USUAL
from ....twin.scenes.assumption import assumed


@dataclass(frozen=True)
class FilmTraits:
    """The cameras: `count` of a `kind` (`camera_kinds.py`), `rate` pictures a second; how far off
    their calibration is; how steadily the hand holds the device."""

    kind: str = USUAL
    count: int = 2
    rate: float = assumed(15.0, "cameras", "Hz", "pictures", off=15.0)
    focal: float = assumed(
        5e-4, "calibration", "1", "error of the focal lengths, standard deviation",
        "the twin's own boards, calibrated (docs/capture.md)",
    )  # fmt: skip
    center: float = assumed(
        1.0, "calibration", "px", "error of the principal points, standard deviation"
    )
    turn: float = assumed(
        0.02, "calibration", "degrees", "error of how cameras look, standard deviation"
    )
    shift: float = assumed(0.2, "calibration", "mm", "error of where they are")
    steady: float = assumed(
        3.0, "cameras", "mm and degrees", "how far the hand that holds the device sways", off=3.0
    )

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise CaptureError(
                f"twin: no cameras are called {self.kind}; there are {', '.join(KINDS)}"
            )
