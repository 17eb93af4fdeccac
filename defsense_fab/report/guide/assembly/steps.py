"""The steps of the assembly guide in the order of the hands, without their pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import groupby

import numpy as np

from ....core.arrays import Float
from ....core.device.device import Device
from ....core.errors import FabricationError
from ....core.mesh import Surface
from ....store.manifest import JoinedPin, Manifest
from . import bench_work as bench
from . import joint_work as joint
from .actions import Action, Kind, in_order
from .plan import actions
from .wording import Words, called, named, pin_letters, sides

# What the guide says of each action.

_SAID: Mapping[Kind, Callable[[Words, Action], list[str]]] = {
    Kind.PRINT: bench.print_parts,
    Kind.CAST: bench.cast_parts,
    Kind.TRY_PINS: bench.try_pins,
    Kind.CUT: bench.cut,
    Kind.CRIMP: bench.crimp,
    Kind.MARK: bench.mark,
    Kind.TRIM: bench.trim,
    Kind.DRY_FIT: joint.dry_fit,
    Kind.PINS: joint.pins,
    Kind.LAY: joint.lay,
    Kind.THREAD: bench.thread,
    Kind.STRETCH: joint.stretch,
    Kind.GLUE_END: joint.glue_end,
    Kind.SET_END: joint.set_end,
    Kind.WIRE: joint.wire,
    Kind.GLUE: joint.glue,
    Kind.SET: joint.set_glue,
    Kind.PULL: bench.pull,
    Kind.SEAT: bench.seat,
    Kind.MEASURE: bench.measure,
    Kind.CONNECT: bench.connect,
}


def sentences(words: Words, action: Action) -> tuple[str, ...]:
    """What to do, and what to look out for."""
    return tuple(_SAID[action.kind](words, action))


_BENCH = {Kind.CUT, Kind.CRIMP, Kind.MARK, Kind.TRIM, Kind.MEASURE}


@dataclass(frozen=True)
class Joint:
    """What is joined in a step: the names of the `lower` parts and of the lighter `upper` ones,
    which are lifted by `lift` mm along `opens` (3,); cords by name, lines (p, 3) mm of wires, and
    pins, with the letters by which the guide names them; its `index` in the assembly."""

    lower: tuple[str, ...]
    upper: tuple[str, ...]
    opens: Float
    lift: float
    cords: tuple[str, ...]
    wires: tuple[Float, ...]
    pins: tuple[JoinedPin, ...]
    letters: tuple[str, ...]
    index: int


class Scene(StrEnum):
    """What a passage of a step is a picture of."""

    NOTHING = "nothing"
    PINS = "pins"
    LAY = "lay"
    CLOSE = "close"
    END = "end"


@dataclass(frozen=True)
class Passage:
    """Some of a step's actions in their order, the sentences of each, and what shows them."""

    actions: tuple[tuple[Action, tuple[str, ...]], ...]
    scene: Scene

    @property
    def lines(self) -> tuple[str, ...]:
        return tuple(line for _, lines in self.actions for line in lines)


@dataclass(frozen=True)
class GuideStep:
    """A title, sentences (those of its passages), and what is joined, if anything is."""

    title: str
    lines: tuple[str, ...]
    joint: Joint | None = None
    passages: tuple[Passage, ...] = ()


def shifts(manifest: Manifest, parts: Mapping[str, Surface]) -> dict[str, Float]:
    """Where each part goes, (3,) mm, when every cut is opened along its normal."""
    out = {name: np.zeros(3) for name in parts}
    size = float(np.linalg.norm(np.ptp([s.bounds for s in parts.values()], axis=(0, 1))))
    for step in manifest.assembly:
        for side, sign in zip(step.join, (-1, 1), strict=True):
            for name in side:
                out[name] = out[name] + sign * 0.1 * size * step.opens
    return out


def order_of(manifest: Manifest) -> tuple[Sequence[Action], str | None]:
    """A device's actions in an order in which hands can do them; where there is none, in that of
    its joints, and why."""
    wished = actions(manifest)
    try:
        return in_order(wished), None
    except FabricationError as error:
        return wished, str(error)


def guide_steps(
    device: Device, manifest: Manifest, parts: Mapping[str, Surface]
) -> tuple[GuideStep, ...]:
    """All steps of a device with its parts by name."""
    groups = [(k, list(g)) for k, g in groupby(order_of(manifest)[0], _group)]
    closed = {
        a.joint: n
        for n, (_, some) in enumerate(groups, start=1)
        for a in some
        if a.kind is Kind.GLUE and a.joint is not None
    }
    words = Words(device, manifest, closed)
    out = []
    for (what, joint), found in groups:
        passages = tuple(
            Passage(tuple((a, sentences(words, a)) for a in these), scene)
            for scene, these in ((s, list(g)) for (s, _), g in groupby(found, _shown))
        )
        lines = tuple(line for p in passages for line in p.lines)
        opened = None
        if what == "join" and joint is not None:
            opened = _opened(joint, manifest, parts)
        out.append(GuideStep(_title(what, joint, found, manifest), lines, opened, passages))
    return tuple(out)


def _group(action: Action) -> tuple[str, int | None]:
    """Which step an action belongs to."""
    if action.kind in (Kind.PRINT, Kind.CAST, Kind.TRY_PINS, Kind.CONNECT):
        return action.kind.value, None
    if action.joint is None:
        return ("cords" if action.kind in _BENCH and not action.late else "thread"), None
    if action.late:
        return "finish", action.joint
    return "join", action.joint


def _scene(action: Action) -> Scene:
    if action.joint is None:
        return Scene.NOTHING
    if action.late:
        return Scene.END
    if action.kind in (Kind.DRY_FIT, Kind.PINS):
        return Scene.PINS
    if action.kind in (Kind.GLUE, Kind.SET, Kind.MEASURE):
        return Scene.CLOSE
    return Scene.LAY


def _shown(action: Action) -> tuple[Scene, str | None]:
    """What an action is shown with: each cord by itself, where no joint is open."""
    scene = _scene(action)
    return scene, action.cord if scene in (Scene.END, Scene.NOTHING) else None


def _title(what: str, joint: int | None, found: Sequence[Action], manifest: Manifest) -> str:
    if joint is not None:
        if what == "finish":
            return f"Crimp the last end of {_cords(found)}"
        verb = "Join" if any(a.kind is Kind.GLUE for a in found) else "Try the joint of"
        if not any(a.kind in (Kind.GLUE, Kind.DRY_FIT) for a in found):
            verb = "Go on with"
        return f"{verb} {sides(manifest.assembly[joint])}"
    return {
        "print": "Print" if manifest.casting is None else "Print the moulds",
        "cast": "Cast the parts",
        "try pins": "Try the pins",
        "cords": "Cut the cords and crimp their wires",
        "thread": f"Put in {_cords(found)}",
        "wire to the board": "Wire and measure",
    }[what]


def _cords(found: Sequence[Action]) -> str:
    return named([called(c) for c in dict.fromkeys(a.cord for a in found if a.cord)])


def _opened(j: int, manifest: Manifest, parts: Mapping[str, Surface]) -> Joint:
    """The lighter side is the one to lift."""
    step = manifest.assembly[j]
    low, high = step.join
    normal = step.opens
    lower, upper = ([parts[n] for n in side] for side in (low, high))
    if sum(s.volume for s in upper) > sum(s.volume for s in lower):
        low, high, normal = high, low, -normal
        lower, upper = upper, lower
    size = np.ptp([s.bounds for s in (*lower, *upper)], axis=(0, 1))
    lift = 0.4 * float(np.linalg.norm(size))
    wires = (e.wire for c in manifest.cords for e in c.ends if j in e.wire.joints)
    lines = tuple(w.line for w in wires if w.line is not None)
    return Joint(low, high, normal, lift, step.cords, lines, step.pins, pin_letters(step), j)
