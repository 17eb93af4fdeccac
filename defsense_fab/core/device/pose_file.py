"""The tables `[[poses]]` and `[states]` of `device.toml`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import Float
from ..storage.file_names import folded
from ..storage.toml_table import Table, is_number
from .default_states import RAMP, default_states
from .device import Handle, PointDrag, Pose, RegionPressure, StatesSpec, SymmetryPlane

#: Largest size of a movement (mm), stiffness, load.
LARGEST = 1e5
MOST_DEGREES = 3600.0
_LONGEST = 60  # letters of a pose's name


def read_poses(top: Table, regions: Sequence[str], required: bool = True) -> tuple[Pose, ...]:
    """All poses. Raises DeviceError with line and key for anything wrong."""
    poses: list[Pose] = []
    for t in top.tables("poses"):
        name = t.string("name")
        like = next(
            (n for n in ("rest", *(p.name for p in poses)) if folded(n) == folded(name)), ""
        )
        if like == name:
            t.fail("name", f"{name!r} is used already; choose another name")
        if like:
            t.fail("name", f"{name!r} and {like!r} are one file for Windows; choose another name")
        if not name.replace("_", "").replace("-", "").isalnum() or len(name) > _LONGEST:
            t.fail("name", f"use up to {_LONGEST} letters, digits, - and _ only: it names files")
        poses.append(_pose(t, name, regions))
    if required and not poses:
        top.fail(
            "poses",
            "add at least one [[poses]] that the device must sense; `defsense modes` proposes some",
        )
    return tuple(poses)


def _pose(t: Table, name: str, regions: Sequence[str]) -> Pose:
    fixed = t.strings("fixed", [])
    for region in fixed:
        t.choice("fixed", region, regions, "region")
    handles = tuple(_handle(h, regions) for h in t.tables("handles"))
    moved = [h.region for h in handles]
    if len(set(moved)) < len(moved):
        t.fail("handles", "two handles move the same region; make them one")
    both = set(fixed) & set(moved)
    if both:
        t.fail("handles", f"region {min(both)!r} is fixed and moved; take it out of one")
    pose = Pose(
        name,
        tuple(fixed),
        handles,
        tuple(_symmetry(s, regions) for s in t.tables("symmetry")),
        tuple(_drag(d) for d in t.tables("drags")),
        tuple(_pressure(p, regions) for p in t.tables("pressures")),
        _sane(t, "gravity", t.vector("gravity")) if t.has("gravity") else np.zeros(3),
    )
    if not (fixed or handles or pose.symmetry or pose.drags):
        t.fail("fixed", "needs at least one region, or the body can move freely")
    loaded = pose.drags or pose.pressures or pose.gravity.any()
    if not handles and not loaded:
        t.fail("handles", "needs a handle that moves a region, a drag, a pressure or gravity")
    if not loaded and not any(
        h.rotation.any() or np.nan_to_num(h.translation).any() for h in handles
    ):
        t.fail("handles", "nothing moves; give a handle a rotation or a translation")
    t.done()
    return pose


def _unit(t: Table, key: str) -> Float:
    vector = t.vector(key)
    largest = float(np.abs(vector).max())
    if largest == 0:
        t.fail(key, "must not be zero")
    vector = vector / largest
    return np.asarray(vector / np.linalg.norm(vector))


def _sane(t: Table, key: str, values: Float) -> Float:
    """Numbers that a real device can have; beyond, arithmetic overflows."""
    beyond = f"has a number beyond {LARGEST:g}, which no device can mean"
    t.within(key, values, -LARGEST, LARGEST, beyond)
    return values


def _handle(t: Table, regions: Sequence[str]) -> Handle:
    region = t.string("region")
    t.choice("region", region, regions, "region")
    rotation, free, about = np.zeros(3), np.zeros((0, 3)), None
    if t.raw("rotate") == "free":
        free = np.eye(3)
    elif isinstance(t.raw("rotate"), str):
        t.fail("rotate", 'must be "free" or { axis = [x, y, z], degrees = 30 }')
    elif t.has("rotate"):
        r = t.table("rotate")
        axis = _unit(r, "axis")
        about = _sane(r, "about", r.vector("about")) if r.has("about") else None
        if r.raw("degrees") == "free":
            free = axis[None]
        else:
            degrees = r.number("degrees")
            most = f"must be within {MOST_DEGREES:g}, not {degrees:g}"
            r.within("degrees", degrees, -MOST_DEGREES, MOST_DEGREES, most)
            rotation = axis * np.deg2rad(degrees)
        r.done()
    translation = _translation(t)
    t.done()
    return Handle(region, rotation, translation, free, about)


def _translation(t: Table) -> Float:
    """(3,) mm, NaN where free: "free", [x, y, z], or a list with "free" in it."""
    value = t.raw("translate", [0.0, 0.0, 0.0])
    if value == "free":
        return np.full(3, np.nan)
    if (
        not isinstance(value, list)
        or len(value) != 3
        or not all(v == "free" or is_number(v) for v in value)
    ):
        t.fail("translate", f'must be "free" or [x, y, z] in mm, each may be "free"; not {value!r}')
    known = [float(v) for v in value if v != "free"]
    _sane(t, "translate", np.array(known))
    return np.array([np.nan if v == "free" else float(v) for v in value])


def _symmetry(t: Table, regions: Sequence[str]) -> SymmetryPlane:
    region = t.string("region")
    t.choice("region", region, regions, "region")
    plane = SymmetryPlane(region, _unit(t, "normal"))
    t.done()
    return plane


def _drag(t: Table) -> PointDrag:
    stiffness = t.number("stiffness", 1.0, low=0)
    _sane(t, "stiffness", np.array([stiffness]))
    drag = PointDrag(_sane(t, "at", t.vector("at")), _sane(t, "by", t.vector("by")), stiffness)
    t.done()
    return drag


def _pressure(t: Table, regions: Sequence[str]) -> RegionPressure:
    region = t.string("region")
    t.choice("region", region, regions, "region")
    pressure = RegionPressure(region, float(_sane(t, "value", np.array([t.number("value")]))[0]))
    t.done()
    return pressure


def _weights(t: Table, key: str, poses: Sequence[str]) -> tuple[dict[str, float], ...]:
    out = []
    for row in t.tables(key):
        for name in row.data:
            row.choice(name, name, poses, "pose")
        if not row.data:
            t.fail(key, "an empty mixture; give at least one pose = weight")
        out.append({name: row.number(name) for name in row.data})
        if not any(out[-1].values()):
            t.fail(key, "all weights are zero; this is the rest state")
    return tuple(out)


def read_states(t: Table, of: Sequence[Pose]) -> StatesSpec:
    """The `[states]` table; without mixtures in it, those that cover what the poses span."""
    poses = [p.name for p in of]
    ramp = t.array("ramp", (None,), RAMP)
    if len(ramp) == 0 or (ramp <= 0).any() or (ramp > 1).any():
        t.fail("ramp", "must be fractions above 0 and up to 1, for example [0.5, 1.0]")
    fractions = tuple(float(r) for r in np.unique(ramp))
    if t.has("mixtures") or t.has("held_out"):
        mixtures, held_out = _weights(t, "mixtures", poses), _weights(t, "held_out", poses)
        spec = StatesSpec(fractions, mixtures, held_out)
    else:
        spec = default_states(of, fractions)
    t.done()
    _refuse_twins(t, spec, poses)
    return spec


def _refuse_twins(t: Table, spec: StatesSpec, poses: Sequence[str]) -> None:
    """The same state twice: it would count double, or be both seen and held out."""
    seen = {f"{fraction:g}" for fraction in spec.ramp}
    if len(seen) < len(spec.ramp):
        t.fail("ramp", "two fractions are nearly the same; remove one")
    known = {(name, fraction) for name in poses for fraction in seen}
    for key, mixtures in (("mixtures", spec.mixtures), ("held_out", spec.held_out)):
        for mixture in mixtures:
            parts = tuple(sorted((n, f"{w:g}") for n, w in mixture.items() if w))
            single = parts[0] if len(parts) == 1 else parts
            if single in known:
                t.fail(key, f"the state {dict(mixture)} is there already; remove one")
            known.add(single)  # type: ignore[arg-type]
