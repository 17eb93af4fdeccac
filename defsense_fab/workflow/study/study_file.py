"""The file `study.toml`: what a study varies, and the points at which it runs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn

import msgspec
import numpy as np
from msgspec import Meta

from ...core.errors import DefsenseError, StudyError
from ...core.schema.declare import Positive, Problem, Table, key, missing, unknown_choice
from ...core.schema.document import Document, errors_in, load_document
from ...core.schema.key_lines import KeyPath
from ...core.schema.reader import Reader
from ...core.schema.types import is_number
from .measures import MEASURED_STAGES, WORDS, measures_until

FILE = "study.toml"
LATIN_HYPERCUBE = "latin-hypercube"
DESIGNS = ("grid", "list", LATIN_HYPERCUBE)
_KINDS = ("range", "uniform", "log_uniform")
_MAX_RUNS = 100_000
_MAX_STEPS = 10_000
_SIGNIFICANT_DIGITS = 6  # of drawn numbers: as many as a person would write

#: Values of all parameters by key; one point per run.
Point = dict[str, Any]
#: The parameter whose values are the names of variants.
VARIANT = "variant"
_Interval = tuple[float, float]


class Distribution(Table, frozen=True):
    """Values of a parameter that are not listed: exactly one of range, uniform and log_uniform."""

    range: Annotated[
        _Interval | None,
        key("First and last of evenly spaced values; needs `step` or `steps`.", default="none"),
    ] = None
    step: Annotated[
        Positive | None, key("Distance of the values of a `range`.", default="this or `steps`")
    ] = None
    steps: Annotated[
        Annotated[int, Meta(ge=2)] | None,
        key("Number of the values of a `range`, ends included.", default="this or `step`"),
    ] = None
    uniform: Annotated[
        _Interval | None,
        key("Smallest and largest number, for a Latin hypercube.", default="none"),
    ] = None
    log_uniform: Annotated[
        _Interval | None,
        key("The same, with evenly distributed logarithms.", default="none"),
    ] = None

    @property
    def kind(self) -> str:
        """The first kind that is given."""
        return next(kind for kind in _KINDS if getattr(self, kind) is not None)

    def check(self) -> Iterator[Problem]:
        """Yield problems of kinds that exclude each other, and of limits and steps."""
        given = [kind for kind in _KINDS if getattr(self, kind) is not None]
        if len(given) > 1:
            text = f"{given[0]} is given too"
            yield Problem((given[1],), text, "keys-exclusive", f"Give one of {', '.join(_KINDS)}")
            return
        kind = given[0]
        low, high = getattr(self, kind)
        if low >= high:
            text = "the first number must be less than the second"
            yield Problem((kind,), text, "not-increasing", "Exchange them")
        elif kind == "log_uniform" and low <= 0:
            text = "both numbers must be above 0"
            yield Problem((kind,), text, "out-of-range", "Increase the first")
        elif kind == "range":
            yield from self._check_steps(low, high)
        for name in ("step", "steps"):
            if kind != "range" and getattr(self, name) is not None:
                yield Problem((name,), "is for a range", "key-not-applicable", "Remove it")

    def _check_steps(self, low: float, high: float) -> Iterator[Problem]:
        if (self.step is None) == (self.steps is None):
            text = "needs either step or steps"
            action = "Give either step = 0.5, or steps = 5 for the number of values"
            yield Problem(("range",), text, "keys-exclusive", action)
            return
        steps = (self.steps or 0) if self.step is None else (high - low) / self.step + 1 + 1e-9
        if steps > _MAX_STEPS:
            text = f"makes more than {_MAX_STEPS} values"
            yield Problem(("range",), text, "too-many-values", "Use larger steps")


class StudyFile(Table, frozen=True, kw_only=True):
    """All keys of `study.toml`."""

    schema: Annotated[Literal[1], key("Version of this format.")] = 1
    parameters: Annotated[
        dict[str, Any],
        key(
            "Dotted keys of `device.toml` with their values: a list, `{ range = [1, 4], step = 1"
            " }`, `{ range = [0, 1], steps = 5 }`, `{ uniform = [1, 4] }` or `{ log_uniform ="
            " [0.1, 10] }`.",
            default="needed without `variants`",
        ),
    ] = msgspec.field(default_factory=dict)
    variants: Annotated[
        tuple[dict[str, Any], ...],
        key(
            "Devices that are compared: each has a `name`, and keys of `device.toml` whose tables"
            " or values it replaces as a whole. Each is combined with all `parameters`, like the"
            " values of one more parameter."
        ),
    ] = ()
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
    until: Annotated[str, key("Stage that each run goes to.", choices=MEASURED_STAGES)] = "optimize"
    minimise: Annotated[
        str | None,
        key(
            'Measure by which runs are ranked, smallest first, or `"none"`.',
            default="`error`, if runs have it",
        ),
    ] = None
    time_limit: Annotated[Positive, key("Longest time of a run.", unit="s")] = 7200.0

    @property
    def measures(self) -> list[str]:
        """The measures that runs have."""
        return measures_until(self.until)

    @property
    def minimized(self) -> str | None:
        """The measure by which runs are ranked; None without ranks."""
        name = self.minimise or ("error" if "error" in self.measures else "none")
        return None if name == "none" else name

    @property
    def main_measure(self) -> str:
        """The measure that is minimized, or else the first one."""
        return self.minimized or self.measures[0]

    def check(self) -> Iterator[Problem]:
        """Yield problems of a measure that a run does not have, and of keys of another design."""
        numbers = [name for name in self.measures if name not in WORDS]
        if self.minimized is not None and self.minimized not in numbers:
            noun = f"number that a run until {self.until} has"
            yield unknown_choice(("minimise",), self.minimized, numbers, noun, "unknown-measure")
        if self.design == LATIN_HYPERCUBE:
            if self.count is None:
                yield missing("count")
            return
        for name in ("count", "seed"):
            if getattr(self, name) is not None:
                text = f'is for design = "{LATIN_HYPERCUBE}", not for {self.design!r}'
                yield Problem((name,), text, "key-not-applicable", "Remove it")


@dataclass(frozen=True)
class Parameter:
    """A parameter of a study.

    Attributes:
        key: Dotted key of `device.toml`.
        path: Its place in `study.toml`.
        values: The values that it takes; empty if numbers are drawn.
        bounds: Smallest and largest number that is drawn; None without a distribution.
        is_logarithmic: Whether the logarithms of the drawn numbers are evenly distributed.
    """

    key: str
    path: KeyPath
    values: tuple[Any, ...] = ()
    bounds: tuple[float, float] | None = None
    is_logarithmic: bool = False

    def at(self, share: float) -> Any:
        """Return the quantile of a `share` from 0 to below 1; listed values occur equally often."""
        if self.bounds is None:
            return self.values[int(share * len(self.values))]
        low, high = self.bounds
        if self.is_logarithmic:
            value = float(np.exp(np.log(low) + share * np.log(high / low)))
        else:
            value = low + share * (high - low)
        return float(f"{value:.{_SIGNIFICANT_DIGITS}g}")


@dataclass(frozen=True)
class Study:
    """A parameter study.

    Attributes:
        parameters: The parameters that vary: the variants, if any, and those of the file in their
            order.
        file: All other keys.
        document: The file, for errors with lines.
    """

    parameters: tuple[Parameter, ...]
    file: StudyFile
    document: Document

    def changes(self, point: Point) -> Point:
        """Return the values of a point by dotted key of `device.toml`, those of its variant first.

        Other parameters then change what the variant has put there.
        """
        values = {k: v for k, v in point.items() if k != VARIANT}
        if not self.file.variants:
            return values
        table = next(v for v in self.file.variants if v["name"] == point[VARIANT])
        return {k: v for k, v in table.items() if k != "name"} | values

    def points(self) -> list[Point]:
        """Return all points of the design, the same for equal files."""
        keys = [p.key for p in self.parameters]
        if self.file.design == LATIN_HYPERCUBE:
            from scipy.stats import qmc

            seed = 1 if self.file.seed is None else self.file.seed
            shares = qmc.LatinHypercube(len(keys), rng=seed).random(self.file.count)
            return [
                {p.key: p.at(float(u)) for p, u in zip(self.parameters, row, strict=True)}
                for row in shares
            ]
        combine = itertools.product if self.file.design == "grid" else zip
        rows = combine(*(p.values for p in self.parameters))
        return [dict(zip(keys, row, strict=True)) for row in rows]

    def refuse_variant(self, name: str, error: DefsenseError) -> NoReturn:
        """Raise an error for a variant that gives no device, with the line of the key.

        Raises:
            StudyError: Always.
        """
        number = [v["name"] for v in self.file.variants].index(name)
        keys = str(errors_in(error)[0].data.get("key") or "").split(".")
        path: KeyPath = ("variants", number, *keys)
        if self.document.line(path) == self.document.line(path[:2]):
            path = path[:2]
        text = f"{name!r} gives no device: {error}"
        self.document.refuse([Problem(path, text, "variant-invalid", data={"variant": name})])

    def refuse(self, name: str, text: str, code: str, action: str = "", **data: object) -> NoReturn:
        """Raise an error for the parameter `name`, with its line.

        Raises:
            StudyError: Always.
        """
        path = next(p.path for p in self.parameters if p.key == name)
        self.document.refuse([Problem(path, text, code, action, {"parameter": name, **data})])


def has_study_file(folder: Path) -> bool:
    """Return whether the device's folder has a `study.toml`."""
    return (folder / FILE).is_file()


def load_study(folder: Path) -> Study:
    """Read the `study.toml` of a folder.

    Raises:
        StudyError: With file, line and key, for all problems of the file.
    """
    document = load_document(folder / FILE, StudyError)
    file = document.read(StudyFile)
    parameters, problems = _read_parameters(file.parameters)
    if file.variants:
        problems += _check_variants(file.variants, parameters)
        names = tuple(v.get("name") for v in file.variants)
        parameters = (Parameter(VARIANT, ("variants",), names), *parameters)
    problems = problems or list(_check_design(file.design, parameters))
    if problems:
        document.refuse(problems)
    return Study(parameters, file, document)


def _read_parameters(table: Mapping[str, Any]) -> tuple[tuple[Parameter, ...], list[Problem]]:
    """Return the parameters of the table `[parameters]`, and all problems."""
    problems: list[Problem] = []
    parameters: dict[str, Parameter] = {}
    for path, value in _leaves(table, ("parameters",)):
        dotted = ".".join(map(str, path[1:]))
        if isinstance(value, list):
            if not value:
                action = "Give at least one value"
                problems.append(Problem(path, "the list is empty", "too-few-items", action))
            elif not all(map(_is_plain, value)):
                text = "must contain numbers, texts, true and false"
                problems.append(Problem(path, text, "value-type"))
            parameter = Parameter(dotted, path, tuple(value))
        elif isinstance(value, Mapping) and value:
            reader = Reader()
            distribution = reader.read_table(Distribution, value, path)
            problems += reader.problems
            if distribution is None or reader.problems:
                continue
            parameter = _distributed(dotted, path, distribution, value)
        else:
            text = (
                "must be a list of values, or one of { range = [1, 4], step = 1 },"
                f" {{ uniform = [1, 4] }} and {{ log_uniform = [0.1, 10] }}, not {value!r}"
            )
            problems.append(Problem(path, text, "value-type"))
            continue
        if dotted in parameters:
            text = "is given twice, with and without quotes"
            problems.append(Problem(path, text, "key-repeated", "Omit one of them"))
        parameters[dotted] = parameter
    return tuple(parameters.values()), problems


def _check_variants(
    variants: Sequence[Mapping[str, Any]], parameters: Sequence[Parameter]
) -> Iterator[Problem]:
    """Yield problems of the variants' names and values."""
    names: set[str] = set()
    for number, variant in enumerate(variants):
        path, name = ("variants", number), variant.get("name")
        if name is None:
            yield Problem(path, "has no name", "key-missing", 'Add name = "..."')
        elif not isinstance(name, str) or not name.strip() or not name.isprintable():
            yield Problem((*path, "name"), f"{name!r} is not a name", "name-invalid", "Use letters")
        elif name in names:
            text = f"{name!r} is used already"
            yield Problem((*path, "name"), text, "name-repeated", "Choose another name")
        names.add(str(name))
        for key_name, value in variant.items():
            if not _is_plain(value):
                text = "must contain numbers, texts, true and false"
                yield Problem((*path, key_name), text, "value-type")
    for parameter in parameters:
        if parameter.key == VARIANT:
            text = "is the name of the variants"
            yield Problem(parameter.path, text, "key-repeated", "Omit it")


def _leaves(table: Mapping[str, Any], at: KeyPath) -> Iterator[tuple[KeyPath, Any]]:
    """Yield paths and values of parameters; TOML makes tables in tables of plain dotted keys."""
    for name, value in table.items():
        path = (*at, name)
        if isinstance(value, Mapping) and value and set(_KINDS).isdisjoint(value):
            yield from _leaves(value, path)
        else:
            yield path, value


def _is_plain(value: Any) -> bool:
    """Return whether JSON, in which runs are described, has a value of this kind."""
    if isinstance(value, list | dict):
        return all(map(_is_plain, value.values() if isinstance(value, dict) else value))
    return isinstance(value, bool | str) or is_number(value)


def _distributed(
    dotted: str, path: KeyPath, distribution: Distribution, written: Mapping[str, Any]
) -> Parameter:
    """Return the parameter of a distribution; a range of whole numbers has whole values."""
    low, high = getattr(distribution, distribution.kind)
    if distribution.range is None:
        is_logarithmic = distribution.kind == "log_uniform"
        return Parameter(dotted, path, (), (low, high), is_logarithmic)
    is_whole = False
    if distribution.step is None:
        values = np.linspace(low, high, distribution.steps or 0)
    else:
        is_whole = all(isinstance(v, int) for v in (*written["range"], written["step"]))
        count = int((high - low) / distribution.step + 1e-9) + 1
        values = low + distribution.step * np.arange(count)
    return Parameter(
        dotted, path, tuple(int(v) if is_whole else float(f"{v:.12g}") for v in values)
    )


def _check_design(design: str, parameters: tuple[Parameter, ...]) -> Iterator[Problem]:
    """Yield problems of parameters that a design cannot combine."""
    if not parameters:
        text = "there is nothing to vary"
        action = "Give a parameter, as in cord.noise = [0.001, 0.01], or [[variants]]"
        yield Problem(("parameters",), text, "too-few-items", action)
    if not parameters or design == LATIN_HYPERCUBE:
        return
    without = [p for p in parameters if not p.values]
    for parameter in without:
        action = f'Give a list or a range, or use design = "{LATIN_HYPERCUBE}"'
        yield Problem(parameter.path, f"a {design} needs values", "values-missing", action)
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
