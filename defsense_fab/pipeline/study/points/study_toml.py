"""`study.toml` to a Study, with every key checked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ....core.storage.toml_table import Table, load_toml
from ...build.stages import STAGES
from .measures import WORDS, of_stage
from .parameters import Parameter, read_parameters

FILE, SCHEMA = "study.toml", 1
DESIGNS = ("grid", "list", "latin-hypercube")
#: Stages that a run may go to; reports of many runs nobody reads.
UNTIL = tuple(s.name for s in STAGES if s.name != "report")
_MOST_RUNS = 100_000
_TIME_LIMIT = 7200.0


@dataclass(frozen=True)
class Study:
    """What is studied: the parameters and the design of their points (`count` and `seed` are of a
    latin hypercube), the stage that each run goes to, the measures that are recorded, the one that
    is to be small (None: none), the longest that a run may take (s), and the table it was read
    from, for errors."""

    parameters: tuple[Parameter, ...]
    design: str
    count: int
    seed: int
    until: str
    record: tuple[str, ...]
    minimise: str | None
    time_limit: float
    table: Table


def is_there(folder: Path) -> bool:
    """Whether the device's folder has a `study.toml`."""
    return (folder / FILE).is_file()


def load_study(folder: Path) -> Study:
    """Read `folder/study.toml`. Raises DeviceError with file, line and key."""
    top = load_toml(folder / FILE)
    if top.raw("schema", SCHEMA) is not SCHEMA:
        top.fail("schema", f"this version reads schema {SCHEMA}, not {top.data['schema']!r}")
    until = top.string("until", "optimize")
    top.choice("until", until, UNTIL, "stage")
    design = top.string("design", DESIGNS[0])
    top.choice("design", design, DESIGNS, "design")
    parameters = read_parameters(top.table("parameters"))
    if not parameters:
        top.fail("parameters", "give at least one, as in cord.noise = [0.001, 0.01]")
    measured = of_stage(until)
    record = top.strings("record", measured)
    if not record:
        top.fail("record", f"give at least one of {', '.join(measured)}")
    for name in record:
        top.choice("record", name, measured, f"measure of the stage {until}")
    minimise = top.string("minimise", "error" if "error" in record else "none")
    if minimise != "none":
        numbers = [name for name in record if name not in WORDS]
        top.choice("minimise", minimise, numbers, "recorded measure that is a number")
    study = Study(
        parameters=parameters,
        design=design,
        count=_count(top) if design == "latin-hypercube" else 0,
        seed=_whole(top, "seed", 1) if design == "latin-hypercube" else 0,
        until=until,
        record=tuple(record),
        minimise=None if minimise == "none" else minimise,
        time_limit=top.number("time_limit", _TIME_LIMIT, low=0),
        table=top,
    )
    for key in ("count", "seed"):
        if design != "latin-hypercube" and top.has(key):
            top.fail(key, f'is for design = "latin-hypercube", not for {design!r}')
    _fits(study)
    top.done()
    return study


def _count(top: Table) -> int:
    value = _whole(top, "count")
    if not 2 <= value <= _MOST_RUNS:
        top.fail("count", f"must be from 2 to {_MOST_RUNS}, not {value}")
    return value


def _whole(top: Table, key: str, default: int | None = None) -> int:
    value = top.number(key, default)
    if value != int(value) or value < 0:
        top.fail(key, "must be a whole number that is not negative")
    return int(value)


def _fits(study: Study) -> None:
    """What a design asks of the parameters."""
    top, sizes = study.table, {p.key: len(p.values) for p in study.parameters}
    if study.design == "latin-hypercube":
        return
    for key, size in sizes.items():
        if size == 0:
            fail_at(
                study,
                key,
                f"a {study.design} needs values: give a list or a range, or design ="
                ' "latin-hypercube"',
            )
    if study.design == "list" and len(set(sizes.values())) > 1:
        told = ", ".join(f"{key} has {n}" for key, n in sizes.items())
        top.fail("parameters", f"a list needs as many values of each parameter; {told}")
    runs = 1
    for size in sizes.values():
        runs *= size
    if study.design == "grid" and runs > _MOST_RUNS:
        top.fail("parameters", f"make a grid of {runs} points; {_MOST_RUNS} are the most")


def fail_at(study: Study, key: str, problem: str) -> None:
    """Raise DeviceError for a parameter of the study, with its line."""
    table, name = study.table.table("parameters"), key
    while name not in table.data:  # plain dotted keys of TOML are tables in tables
        first = next(n for n in table.data if name.startswith(f"{n}."))
        table, name = table.table(first), name[len(first) + 1 :]
    table.fail(name, problem)
