"""Read `study.toml` into a Study."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn

from msgspec import Meta

from ....core.errors import StudyError
from ....core.schema.declare import Positive, Problem, Table, key, missing, unknown_choice
from ....core.schema.document import Document, load_document
from ...build.stages import STAGES
from .measures import WORDS, measures_until
from .parameters import Parameter, read_parameters

FILE = "study.toml"
DESIGNS = ("grid", "list", "latin-hypercube")
#: Stages that a run may go to; nobody reads the reports of many runs.
UNTIL = tuple(s.name for s in STAGES if s.name != "report")
_MAX_RUNS = 100_000
_DRAWN = "latin-hypercube"


class StudyFile(Table, frozen=True, kw_only=True):
    """All keys of `study.toml`."""

    schema: Annotated[Literal[1], key("Version of this format.")] = 1
    parameters: Annotated[
        dict[str, Any],
        key(
            "Dotted keys of `device.toml` with their values: a list, `{ range = [1, 4], step = 1"
            " }`, `{ range = [0, 1], steps = 5 }`, `{ uniform = [1, 4] }` or `{ log_uniform ="
            " [0.1, 10] }`."
        ),
    ]
    design: Annotated[
        str,
        key(
            "Points that are run: all combinations (`grid`), the values of all parameters together"
            " (`list`), or evenly distributed random points (`latin-hypercube`).",
            choices=DESIGNS,
        ),
    ] = DESIGNS[0]
    count: Annotated[
        Annotated[int, Meta(ge=2, le=_MAX_RUNS)] | None,
        key("Number of points of a Latin hypercube.", default="required by a Latin hypercube"),
    ] = None
    seed: Annotated[
        Annotated[int, Meta(ge=0)] | None,
        key("Seed of the random numbers of a Latin hypercube.", default="`1`"),
    ] = None
    until: Annotated[str, key("Stage that each run goes to.", choices=UNTIL)] = "optimize"
    record: Annotated[
        tuple[str, ...] | None,
        key("Measures that are recorded.", default="all that the stage has"),
    ] = None
    minimise: Annotated[
        str | None,
        key(
            'Recorded measure by which runs are ranked, smallest first, or `"none"`.',
            default="`error`, if it is recorded",
        ),
    ] = None
    time_limit: Annotated[Positive, key("Longest time of a run.", unit="s")] = 7200.0

    @property
    def measures(self) -> tuple[str, ...]:
        """The measures that are recorded."""
        return tuple(measures_until(self.until)) if self.record is None else self.record

    @property
    def minimised(self) -> str | None:
        """The measure by which runs are ranked, or None."""
        name = self.minimise or ("error" if "error" in self.measures else "none")
        return None if name == "none" else name

    def check(self) -> Iterator[Problem]:
        """Yield problems of measures that a run does not have, and of keys of another design."""
        available = measures_until(self.until)
        if not self.measures:
            text = "there is nothing to record"
            action = f"Give at least one of {', '.join(available)}"
            yield Problem(("record",), text, "too-few-items", action)
        unknown = next((name for name in self.measures if name not in available), None)
        if unknown is not None:
            noun = f"measure of the stage {self.until}"
            yield unknown_choice(("record",), unknown, available, noun, "unknown-measure")
        numbers = [name for name in self.measures if name not in WORDS]
        if self.minimised is not None and self.minimised not in numbers:
            noun = "recorded measure that is a number"
            yield unknown_choice(("minimise",), self.minimised, numbers, noun, "unknown-measure")
        if self.design == _DRAWN:
            if self.count is None:
                yield missing("count")
            return
        for name in ("count", "seed"):
            if getattr(self, name) is not None:
                text = f'is for design = "{_DRAWN}", not for {self.design!r}'
                yield Problem((name,), text, "key-not-applicable", "Remove it")


@dataclass(frozen=True)
class Study:
    """A parameter study.

    Attributes:
        parameters: What is varied.
        design: How their values are combined: one of DESIGNS.
        count: Number of points of a Latin hypercube, else 0.
        seed: Seed of a Latin hypercube, else 0.
        until: Stage that each run goes to.
        record: Measures that are recorded.
        minimise: The measure that should be small, or None.
        time_limit: Longest time of a run, s.
        document: The file, for errors with lines.
    """

    parameters: tuple[Parameter, ...]
    design: str
    count: int
    seed: int
    until: str
    record: tuple[str, ...]
    minimise: str | None
    time_limit: float
    document: Document

    def refuse(self, name: str, text: str, code: str, action: str = "", **data: object) -> NoReturn:
        """Raise an error for the parameter `name`, with its line.

        Raises:
            StudyError: always.
        """
        path = next(p.path for p in self.parameters if p.key == name)
        self.document.refuse([Problem(path, text, code, action, {"parameter": name, **data})])


def is_there(folder: Path) -> bool:
    """Return whether the device's folder has a `study.toml`."""
    return (folder / FILE).is_file()


def load_study(folder: Path) -> Study:
    """Read the `study.toml` of a folder.

    Raises:
        StudyError: with file, line and key, for everything that is wrong in it.
    """
    document = load_document(folder / FILE, StudyError)
    declared = document.read(StudyFile)
    parameters, problems = read_parameters(declared.parameters)
    problems = problems or list(_check_design(declared.design, parameters))
    if problems:
        document.refuse(problems)
    seed = 1 if declared.seed is None else declared.seed
    return Study(
        parameters=parameters,
        design=declared.design,
        count=declared.count or 0,
        seed=seed if declared.design == _DRAWN else 0,
        until=declared.until,
        record=declared.measures,
        minimise=declared.minimised,
        time_limit=declared.time_limit,
        document=document,
    )


def _check_design(design: str, parameters: tuple[Parameter, ...]) -> Iterator[Problem]:
    """Yield problems of parameters that a design cannot combine."""
    if not parameters:
        text = "there is nothing to vary"
        action = "Give at least one parameter, as in cord.noise = [0.001, 0.01]"
        yield Problem(("parameters",), text, "too-few-items", action)
    if not parameters or design == _DRAWN:
        return
    without = [p for p in parameters if not p.values]
    for parameter in without:
        text = f"a {design} needs values"
        action = f'Give a list or a range, or use design = "{_DRAWN}"'
        yield Problem(parameter.path, text, "values-missing", action)
    if without:
        return
    sizes = {p.key: len(p.values) for p in parameters}
    if design == "list" and len(set(sizes.values())) > 1:
        listed = ", ".join(f"{name} has {n}" for name, n in sizes.items())
        text = f"a list needs as many values of each parameter; {listed}"
        yield Problem(("parameters",), text, "lengths-differ", data={"sizes": sizes})
    runs = math.prod(sizes.values())
    if design == "grid" and runs > _MAX_RUNS:
        text = f"make a grid of {runs} points, and at most {_MAX_RUNS} are possible"
        yield Problem(("parameters",), text, "too-many-runs", data={"runs": runs})
