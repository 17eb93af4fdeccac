"""Options of `defsense study` and `defsense modes`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from ...core.errors import StudyError
from ...core.schema.options import check_options

#: Largest number of cords that can be placed.
MAX_CORDS = 16


@dataclass(frozen=True)
class StudyOptions:
    """Options of a study; `workers` and `scheduler` apply to the runs of `study.toml`.

    Attributes:
        sensors: Set the numbers of cords to try, as a range or one number (default: 1..6).
        workers: Set the number of runs at a time on this machine (default: number of cores).
        scheduler: Run study.toml on a Dask cluster with this scheduler address, such as
            tcp://HOST:8786.
    """

    sensors: str | None = None
    workers: Annotated[int, Meta(ge=1, le=512)] | None = None
    scheduler: str | None = None

    def __post_init__(self) -> None:
        check_options(self, StudyError)
        _ = self.cord_counts

    @property
    def cord_counts(self) -> range:
        """The numbers of cords to try.

        Raises:
            StudyError: They are not a range (`range-invalid`), or not possible (`out-of-range`).
        """
        text = "1..6" if self.sensors is None else self.sensors
        low, dots, high = text.partition("..")
        if not (low.isdecimal() and (high.isdecimal() if dots else not high)):
            raise StudyError(
                f"{text} is not a range",
                code="range-invalid",
                where="sensors",
                action="Give a range such as 1..6, or one number",
                value=text,
            )
        first, last = int(low), int(high or low)
        if not 1 <= first <= last <= MAX_CORDS:
            raise StudyError(
                f"{text} is out of range",
                code="out-of-range",
                where="sensors",
                action=f"Give numbers from 1 to {MAX_CORDS}, the smaller one first",
                value=text,
            )
        return range(first, last + 1)


@dataclass(frozen=True)
class ModesOptions:
    """Options of the search for poses among the natural modes of a body.

    Attributes:
        fixed: Set the region that is fixed.
        count: Set the number of modes to compute.
    """

    fixed: str
    count: Annotated[int, Meta(ge=1, le=50)] = 8

    def __post_init__(self) -> None:
        check_options(self)
