"""Options of `defsense reproduce`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from ...core.errors import ExperimentError
from ...core.schema.options import check_options


@dataclass(frozen=True)
class ReproduceOptions:
    """Size and results of experiments.

    Attributes:
        out: Set the output folder (default: reproduced, or reproduced-quick for the small version).
        quick: Run a small version of the experiments, in minutes.
        units: Set the number of built devices per layout (default: the experiment's).
    """

    out: Path | None = None
    quick: bool = False
    units: Annotated[int, Meta(ge=1, le=100)] | None = None

    def __post_init__(self) -> None:
        check_options(self, ExperimentError)

    @property
    def folder(self) -> Path:
        """The output folder."""
        return self.out or Path("reproduced-quick" if self.quick else "reproduced")
