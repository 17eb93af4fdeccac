"""`experiment.toml` to an Experiment, with every key checked."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ....core.curves.bending import RADII
from ....core.device.device_file import DEVICE, read_device
from ....core.errors import DeviceError, ExperimentError
from ....core.storage.file_names import folded, refusal
from ....core.storage.toml_table import Table, load_toml
from ....twin.electronics.cord_kinds import CORD_KINDS
from ....twin.filming.camera_kinds import KINDS
from .experiment import (
    AFFINE,
    BENT_QUANTITIES,
    CHOSEN,
    CORD_QUANTITIES,
    CORDS,
    DRAWN,
    MANUAL,
    OPTIMISED,
    PREDICTED,
    QUANTITIES,
    TOLD_APART,
    VISUAL,
    CordPlan,
    Experiment,
    LayoutChoice,
    PaperNumber,
    QuickPlan,
    SessionPlan,
)

FILE, SCHEMA = "experiment.toml", 1
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9-]*")
#: Names in the experiment's folder of results that are taken.
_TAKEN = ("simulated", "markers", "pictures")
_MOST_UNITS, _MOST_FRAMES = 100, 100_000
_FEWEST_RADII = 3


def load_experiment(folder: Path) -> Experiment:
    """Of the folder with `experiment.toml`, and `device.toml` unless it is of cords alone. Raises
    ExperimentError where there is none, DeviceError with file, line and key for what is wrong in
    it."""
    path = folder / FILE
    if not path.is_file():
        raise ExperimentError(
            f"{path}: no such file; give a folder that holds an {FILE} (docs/reproduce.md)"
        )
    top = load_toml(path)
    if top.raw("schema", SCHEMA) is not SCHEMA:
        top.fail("schema", f"this version reads schema {SCHEMA}, not {top.data['schema']!r}")
    cords = _cords(top.table("cords")) if top.has("cords") else None
    layouts = _layouts(top, folder)
    if bool(layouts) == (cords is not None):
        top.fail("layouts", "give either [[layouts]] of a device to compare, or [cords]")
    if layouts and not (folder / DEVICE).is_file():
        top.fail("layouts", f"are of a device, and {folder} holds no {DEVICE}")
    small = _quick(top.table("quick", required=False))
    found = Experiment(
        name=folder.resolve().name,
        folder=folder,
        title=top.string("title"),
        figures=tuple(top.strings("figures", [])),
        about=top.string("about"),
        layouts=layouts,
        session=_session(top.table("session", required=False)),
        small=small,
        numbers=tuple(_number(t, layouts, cords) for t in top.tables("numbers")),
        cords=cords,
    )
    top.done()
    return found


def _layouts(top: Table, folder: Path) -> tuple[LayoutChoice, ...]:
    out: list[LayoutChoice] = []
    for t in top.tables("layouts"):
        name = t.string("name")
        if not _NAME.fullmatch(name) or name in _TAKEN or refusal(name):
            t.fail("name", f"{name!r} names a folder: letters, digits and hyphens, and none of"
                   f" {', '.join(_TAKEN)}, or of Windows (con, nul, ...)")  # fmt: skip
        if folded(name) in [folded(x.name) for x in out]:
            t.fail("name", f"{name!r} is used already; choose another name")
        cords = t.string("cords")
        t.choice("cords", cords, CORDS, "way to lay cords")
        count = _whole(t, "count", 1, 50) if t.has("count") else None
        if count is None and cords in (MANUAL, VISUAL):
            t.fail("count", f"is missing: {cords} cords need their number")
        file = t.string("file") if t.has("file") else None
        if file is not None and cords not in (DRAWN, OPTIMISED):
            t.fail("file", f"{cords} cords are not drawn; leave it out")
        if file is not None:
            if not (folder / file).is_file():
                t.fail("file", f"there is no {file} in {folder}")
            if not load_toml(folder / file).tables("sensors"):
                t.fail("file", f"{file} has no [[sensors]]; draw them as in {DEVICE}")
        if count is not None and (cords == DRAWN or file is not None):
            t.fail("count", "cords that are drawn are as many as they are; leave it out")
        design = t.table("design", required=False).data
        _refuse_design(t, folder / DEVICE, design)
        out.append(LayoutChoice(name, t.string("title"), cords, count, file, dict(design)))
        t.done()
    return tuple(out)


def _refuse_design(t: Table, path: Path, design: Mapping[str, Any]) -> None:
    """Fail for values of `[design]` that the device does not take; what else is wrong in
    `device.toml` is told where it is read."""
    if not design or not path.is_file():
        return
    top = load_toml(path)
    data = {**top.data, "design": {**top.data.get("design", {}), **design}}
    try:
        read_device(Table(data, path, "", ()), path.parent, {})
    except DeviceError as error:
        problem = str(error).removeprefix(f"{DEVICE}: ")
        if problem.startswith("design"):
            t.fail("design", problem)


def _whole(t: Table, key: str, low: int, high: int, default: Any = None) -> int:
    value = t.number(key, default)
    if value != int(value) or not low <= value <= high:
        t.fail(key, f"must be a whole number from {low} to {high}, not {value:g}")
    return int(value)


def _session(t: Table) -> SessionPlan:
    usual = SessionPlan()
    cameras = t.string("cameras", usual.cameras)
    kind, _, number = cameras.partition(",cameras=")
    t.choice("cameras", kind, list(KINDS), "kind of cameras")
    if number and not (number.isdecimal() and 1 <= int(number) <= 6):
        t.fail("cameras", f"write {kind},cameras=2, with 1 to 6 of them, not {cameras!r}")
    rate = t.number("rate", usual.rate)
    if not 5 <= rate <= 60:
        t.fail("rate", f"must be 5 to 60 pictures a second, not {rate:g}")
    side = t.vector("side") if t.has("side") else None
    if side is not None and not side.any():
        t.fail("side", "is no direction; give the way to the cameras, such as [0, -1, 1]")
    found = SessionPlan(
        frames=_whole(t, "frames", 50, _MOST_FRAMES, usual.frames),
        rate=rate,
        cameras=cameras,
        tags=_whole(t, "tags", 3, 200, usual.tags),
        tag_size=t.number("tag_size", usual.tag_size, low=2),
        side=side,
        units=_whole(t, "units", 1, _MOST_UNITS, usual.units),
    )
    t.done()
    return found


def _quick(t: Table) -> QuickPlan:
    usual = QuickPlan()
    found = QuickPlan(
        edge_length=t.number("edge_length", low=0) if t.has("edge_length") else None,
        frames=_whole(t, "frames", 50, _MOST_FRAMES, usual.frames),
        units=_whole(t, "units", 1, _MOST_UNITS, usual.units),
    )
    t.done()
    return found


def _cords(t: Table) -> CordPlan:
    kinds = t.strings("kinds", list(CORD_KINDS))
    for name in kinds:
        t.choice("kinds", name, list(CORD_KINDS), "kind of cord")
    if not kinds or len(set(kinds)) < len(kinds):
        t.fail("kinds", "give at least one, and each once")
    radii = t.array("radii", (None,)) if t.has("radii") else RADII
    lengths = t.array("lengths", (None,))
    if not len(lengths) or min(lengths) < 50 or max(lengths) > 400:
        t.fail("lengths", "must be mm from 50 to 400, at least one")
    if len(set(lengths)) < len(lengths):
        t.fail("lengths", "give each length once")
    if len(set(radii)) < _FEWEST_RADII or min(radii) <= 0:
        t.fail("radii", f"must be mm above 0, at least {_FEWEST_RADII} different ones")
    found = CordPlan(
        tuple(float(x) for x in lengths),
        tuple(float(r) for r in radii),
        _whole(t, "rounds", 1, 20, 3),
        t.number("k_res", low=0),
        tuple(kinds),
        t.number("strain", 0.1, low=0),
        t.number("sample", 67.0, low=0),
    )
    t.done()
    return found


def _number(t: Table, layouts: tuple[LayoutChoice, ...], cords: CordPlan | None) -> PaperNumber:
    names = [x.name for x in layouts] if cords is None else list(cords.kinds)
    of = t.string("layout" if cords is None else "cord")
    t.choice("layout" if cords is None else "cord", of, names, "name")
    quantity = t.string("quantity")
    t.choice("quantity", quantity, QUANTITIES if cords is None else CORD_QUANTITIES, "quantity")
    over = t.string("over") if t.has("over") else None
    bent = quantity in BENT_QUANTITIES and cords is not None
    if cords is not None and bent and {of, over} - {None, cords.kinds[0]}:
        t.fail("quantity", f"{quantity} is of {cords.kinds[0]} alone, which is on the specimens")
    if over is not None:
        t.choice("over", over, names, "name")
        if over == of:
            t.fail("over", f"a ratio of {of} to itself is 1; name another one")
    decoder = t.string("decoder", CHOSEN)
    t.choice("decoder", decoder, (AFFINE, CHOSEN), "decoder")
    if decoder == AFFINE and quantity == TOLD_APART:
        t.fail("decoder", f"{quantity} is told of the chosen decoder; leave it out")
    bounds = {key: t.number(key) if t.has(key) else None for key in ("at_most", "at_least")}
    if None not in bounds.values():
        t.fail("at_least", "one bound is enough; leave out this or at_most")
    paper = t.number("paper") if t.has("paper") else None
    where = t.string("where", " ").strip()
    if paper is not None and not where:
        t.fail("where", "is missing: where in the paper the number stands")
    found = PaperNumber(
        of, quantity, over, decoder, paper, where, bounds["at_most"], bounds["at_least"],
        t.string("why", " ").strip(),
    )  # fmt: skip
    t.done()
    return found


__all__ = ["FILE", "PREDICTED", "load_experiment"]
