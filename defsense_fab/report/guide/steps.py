"""Divide a device's assembly into steps with instructions, without their pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import groupby

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ...core.storage.files import digest
from ...store.manifest import JoinedPin, JoinStep, Manifest
from .actions import Action, ActionKind, order_actions
from .instructions import (
    GuideContext,
    cord_label,
    describe_sides,
    join_names,
    pin_letters,
    write_instructions,
)
from .plan import plan_actions

_OPENING_SHARE = 0.1  # of the device's size, by which each side of a joint opens
_BENCH_KINDS = {
    ActionKind.CUT,
    ActionKind.CRIMP,
    ActionKind.MARK,
    ActionKind.TRIM,
    ActionKind.MEASURE,
}
#: Kinds of actions that are steps of their own.
_OWN_STEPS = {
    ActionKind.PRINT,
    ActionKind.CAST,
    ActionKind.TRY_PINS,
    ActionKind.FACES,
    ActionKind.CONNECT,
    ActionKind.CHECK,
}


@dataclass(frozen=True)
class Joint:
    """A joint that a step closes.

    Attributes:
        lower: Names of the parts that lie on the table.
        upper: Names of the lighter parts, which are lifted.
        opens: Unit direction (3,) in which the upper parts are lifted.
        across: Unit direction (3,) to the right in pictures and templates: the longest side of the
            lower parts.
        lift: How far pictures lift the upper parts, mm.
        cords: Names of the cords in the joint.
        wires: Lines (p, 3) of the wires in the joint, mm.
        pins: Pins of the joint.
        letters: Letters by which texts and pictures name the pins.
        index: Index of the joint in the manifest's `assembly`.
    """

    lower: tuple[str, ...]
    upper: tuple[str, ...]
    opens: Float
    across: Float
    lift: float
    cords: tuple[str, ...]
    wires: tuple[Float, ...]
    pins: tuple[JoinedPin, ...]
    letters: tuple[str, ...]
    index: int


class Illustration(StrEnum):
    """Subject of a passage's picture."""

    NOTHING = "nothing"
    PINS = "pins"
    LAY = "lay"
    CLOSE = "close"
    END = "end"


@dataclass(frozen=True)
class Passage:
    """Consecutive actions of a step that share a picture.

    Attributes:
        actions: Actions in their order, each with its instructions.
        illustration: Subject of the picture.
    """

    actions: tuple[tuple[Action, tuple[str, ...]], ...]
    illustration: Illustration

    @property
    def lines(self) -> tuple[str, ...]:
        """Instructions of all actions."""
        return tuple(line for _, lines in self.actions for line in lines)


@dataclass(frozen=True)
class GuideStep:
    """A step of the guide.

    Attributes:
        title: Title of the step.
        joint: The joint that the step closes, or None.
        passages: Passages in their order.
        identifier: A short hash of title, instructions, parts and what they are made of, by which
            pages remember finished steps.
    """

    title: str
    joint: Joint | None
    passages: tuple[Passage, ...]
    identifier: str

    @property
    def lines(self) -> tuple[str, ...]:
        """Instructions of all passages."""
        return tuple(line for passage in self.passages for line in passage.lines)


def exploded_shifts(manifest: Manifest, parts: Mapping[str, Surface]) -> dict[str, Float]:
    """Return the displacement (3,) mm of each part when every joint is opened along its normal."""
    size = float(np.linalg.norm(np.ptp([s.bounds for s in parts.values()], axis=(0, 1))))
    shifts = joint_movements(manifest.assembly, list(parts), size).sum(axis=0)
    return dict(zip(parts, shifts, strict=True))


def joint_movements(steps: Sequence[JoinStep], names: Sequence[str], size: float) -> Float:
    """Return the movement of each part when each joint opens along its normal.

    Args:
        steps: Joints, in the order in which they are closed.
        names: Names of the parts.
        size: Diagonal of the device, mm.

    Returns:
        Displacements (steps, parts, 3), mm.
    """
    movements = np.zeros((len(steps), len(names), 3))
    for k, step in enumerate(steps):
        for side, sign in zip(step.join, (-1, 1), strict=True):
            for name in side:
                movements[k, names.index(name)] = sign * _OPENING_SHARE * size * step.opens
    return movements


def assembly_order(manifest: Manifest) -> tuple[Sequence[Action], str | None]:
    """Return a device's actions in a possible order.

    Args:
        manifest: The manifest of the device's parts.

    Returns:
        The actions and None; if no order is possible, the actions joint by joint and the reason.
    """
    actions = plan_actions(manifest)
    try:
        return order_actions(actions), None
    except FabricationError as error:
        return actions, str(error)


def guide_steps(
    device: Device, manifest: Manifest, parts: Mapping[str, Surface]
) -> tuple[GuideStep, ...]:
    """Return the steps that assemble a device.

    Args:
        device: The device.
        manifest: The manifest of its parts.
        parts: Surfaces of its parts, by name.

    Returns:
        The steps in their order.
    """
    groups = [(key, list(g)) for key, g in groupby(assembly_order(manifest)[0], _step_key)]
    step_numbers = {
        action.joint: number
        for number, (_, actions) in enumerate(groups, start=1)
        for action in actions
        if action.kind is ActionKind.GLUE and action.joint is not None
    }
    joints = [_describe_joint(j, manifest, parts) for j in range(len(manifest.assembly))]
    context = GuideContext(device, manifest, step_numbers, [joint.lower for joint in joints])
    shapes = [s.vertices.tobytes() for s in parts.values()]
    made_of = (device.material.name, device.fabrication.process, manifest.copies, manifest.pins)
    steps = []
    for (kind, j), actions in groups:
        passages = tuple(
            Passage(tuple((a, write_instructions(context, a)) for a in group), illustration)
            for (illustration, _), group in groupby(actions, _passage_key)
        )
        joint = joints[j] if kind == "join" and j is not None else None
        title = _write_title(kind, j, actions, manifest)
        lines = [line for passage in passages for line in passage.lines]
        # Cords are cut and crimped before any part is touched.
        what = () if kind == "cords" else (*made_of, *shapes)
        steps.append(GuideStep(title, joint, passages, digest(title, *lines, *what)))
    return tuple(steps)


def _step_key(action: Action) -> tuple[str, int | None]:
    """Return the kind and the joint of the step to which an action belongs."""
    if action.kind in _OWN_STEPS:
        return action.kind.value, None
    if action.kind is ActionKind.PADS:
        return "pads", None
    if action.joint is None:
        is_bench_work = action.kind in _BENCH_KINDS and not action.is_late
        return ("cords" if is_bench_work else "thread"), None
    if action.is_late:
        return "finish", action.joint
    return "join", action.joint


def _illustrate(action: Action) -> Illustration:
    if action.joint is None:
        return Illustration.NOTHING
    if action.is_late:
        return Illustration.END
    if action.kind in (ActionKind.DRY_FIT, ActionKind.PINS):
        return Illustration.PINS
    if action.kind in (ActionKind.GLUE, ActionKind.SET, ActionKind.MEASURE):
        return Illustration.CLOSE
    return Illustration.LAY


def _passage_key(action: Action) -> tuple[Illustration, str | None]:
    """Return the passage of an action; each cord has its own passage where no joint is open."""
    illustration = _illustrate(action)
    is_per_cord = illustration in (Illustration.END, Illustration.NOTHING)
    return illustration, action.cord if is_per_cord else None


def _write_title(
    kind: str, joint: int | None, actions: Sequence[Action], manifest: Manifest
) -> str:
    if joint is not None:
        if kind == "finish":
            return f"Crimp the last end of {_label_cords(actions)}"
        verb = "Join"
        if not any(a.kind is ActionKind.GLUE for a in actions):
            is_tried = any(a.kind is ActionKind.DRY_FIT for a in actions)
            verb = "Try the joint of" if is_tried else "Continue with"
        return f"{verb} {describe_sides(manifest.assembly[joint])}"
    return {
        "print": _title_of_printing(manifest),
        "pads": "Connect wires to the pads",
        "cast": "Cast the parts",
        "try pins": "Try the pins",
        "prepare faces": "Prepare the faces that are glued",
        "cords": "Cut the cords and crimp their wires",
        "thread": f"Insert {_label_cords(actions)}",
        "check wiring": "Check the wiring",
        "wire to the board": f"Connect the {'traces' if manifest.traces else 'cords'} and measure",
    }[kind]


def _title_of_printing(manifest: Manifest) -> str:
    if manifest.traces:
        return "Print the body with its traces"
    return "Print the parts" if manifest.casting is None else "Print the moulds"


def _label_cords(actions: Sequence[Action]) -> str:
    return join_names([cord_label(c) for c in dict.fromkeys(a.cord for a in actions if a.cord)])


def _describe_joint(j: int, manifest: Manifest, parts: Mapping[str, Surface]) -> Joint:
    """Describe a joint whose lighter side is lifted."""
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
    across = _longest_direction(np.concatenate([s.vertices for s in lower]), normal)
    letters = pin_letters(step)
    return Joint(low, high, normal, across, lift, step.cords, lines, step.pins, letters, j)


def _longest_direction(points: Float, normal: Float) -> Float:
    """Return the longest direction (3,) of points across a normal."""
    flat = points - points @ normal[:, None] * normal
    long = np.linalg.svd(flat - flat.mean(0), full_matrices=False)[2][0]
    return np.asarray(long if long @ [1.0, 0.3, 0.2] > 0 else -long)
