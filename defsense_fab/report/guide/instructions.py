"""Write the instructions for actions, from the template `instructions.jinja`."""

from __future__ import annotations

import re
import string
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain, islice
from math import ceil
from typing import Any

import jinja2

from ...core.device.device import Device
from ...core.device.glues import find_glue, find_slow_glue
from ...core.progress import describe_duration
from ...geometry.channels import cord_assembly
from ...store.manifest import END_NAMES, CutCord, JoinStep, Manifest, part_label
from ..html import environment
from .actions import Action
from .plan import (
    BATCH_TOLERANCE,
    INSTALLED_TOLERANCE,
    joint_of_end,
    joints_that_stretch,
    last_joint,
    last_joint_while_wet,
    late_end,
    sliding_end,
    sliding_wires,
)


@dataclass(frozen=True)
class GuideContext:
    """The device, its manifest, and the numbers of the steps, to which instructions refer.

    Attributes:
        device: The device.
        manifest: The manifest of its parts.
        step_numbers: Number of the step in which each joint is closed, by the joint's index.
        lower_parts: Names of the parts that lie on the table while each joint is open.
    """

    device: Device
    manifest: Manifest
    step_numbers: Mapping[int, int]
    lower_parts: Sequence[tuple[str, ...]]


def write_instructions(context: GuideContext, action: Action) -> tuple[str, ...]:
    """Return the instructions for one action, as sentences."""
    manifest = context.manifest
    cords = {c.sensor: c for c in manifest.cords}
    values: dict[str, Any] = {
        "do": action.kind.value,
        "action": action,
        "device": context.device,
        "manifest": manifest,
        "step_numbers": context.step_numbers,
        "cord": None,
        "glue": find_glue(context.device),
        "slow_glue": find_slow_glue(context.device),
        "measured_cords": (measured := [cords[e.cord] for e in action.expected]),
        "glued_cords": [
            c.sensor for c in measured if action.joint is not None and last_joint(c) < action.joint
        ],
    }
    if action.joint is not None:
        joint, last = manifest.assembly[action.joint], last_joint_while_wet(manifest, action.joint)
        values |= {
            "joint": joint,
            "sides": describe_sides(joint),
            "lower_parts": context.lower_parts[action.joint],
            "pins_by_pair": _pins_by_pair(joint, manifest),
            "sliding_wires": sliding_wires(manifest, action.joint),
            "wet_until": None if last is None else context.step_numbers[last],
        }
    if action.cord is not None:
        cord = cords[action.cord]
        free_ends = [k for k, e in enumerate(cord.ends) if e.joint == "free"]
        values |= {
            "cord": cord,
            "label": cord_label(cord.sensor),
            "ranges": [
                f"from {s.start:.0f} to {s.stop:.0f} mm"
                for s in cord.stretches
                if s.joint == action.joint
            ],
            "ends_here": [k for k in (0, 1) if joint_of_end(cord, k) == action.joint],
            "later_steps": sorted(context.step_numbers[j] for j in joints_that_stretch(cord)),
            "free_end": free_ends[-1] if free_ends else None,
        }
        if action.end is not None:
            end = cord.ends[action.end]
            here = -1 if action.joint is None else context.step_numbers[action.joint]
            values |= {
                "end": END_NAMES[action.end],
                "cord_end": end,
                "wire_steps": (steps := [context.step_numbers[j] for j in end.wire.joints]),
                "next_wire_step": min((n for n in steps if n > here), default=None),
            }
    sentences = re.split(r"^\s*- ", _template().render(values), flags=re.MULTILINE)[1:]
    return tuple(" ".join(sentence.split()) for sentence in sentences)


@cache
def _template() -> jinja2.Template:
    text_environment = environment().overlay()
    text_environment.filters = {  # an overlay shares those of the pages
        **text_environment.filters,
        "n": _format_number,
        "n_up": lambda number: str(ceil(number)),
        "percent": "{:.0%}".format,
        "ohm": format_resistance,
        "names": join_names,
        "label": cord_label,
        "parts": label_parts,
        "part": part_label,
        "hours": lambda hours: describe_duration(3600 * hours),
    }
    functions = (joints_that_stretch, late_end, pulled_reach, pulled_strain, sliding_end)
    constants = {"END_NAMES": END_NAMES, "INSTALLED_TOLERANCE": INSTALLED_TOLERANCE}
    return text_environment.get_template(
        "guide/instructions.jinja", globals={f.__name__: f for f in functions} | constants
    )


def _format_number(number: float, decimals: int = 0) -> str:
    return f"{number:.{decimals}f}"


def _pins_by_pair(joint: JoinStep, manifest: Manifest) -> list[tuple[tuple[str, ...], list[Any]]]:
    """Return for each pair of parts the letters and the kinds of the pins between them."""
    kinds = {p.name: p for p in manifest.pins}
    lettered = list(zip(pin_letters(joint), joint.pins, strict=True))
    return [
        (pair, [(letter, kinds[p.name]) for letter, p in lettered if p.between == pair])
        for pair in dict.fromkeys(p.between for p in joint.pins)
    ]


def pulled_reach(device: Device, cord: CutCord, end: int) -> float:
    """Return how far outside its mouth an end's mark must be to crimp its ferrule, mm."""
    return cord_assembly.crimping_reach(device.cord.ferrule_length, cord.ends[end].lead)


def pulled_strain(device: Device, cord: CutCord, end: int) -> float:
    """Return the strain of a cord whose mark is pulled out that far."""
    record = cord.ends[end]
    return cord_assembly.crimping_strain(
        cord.between_ferrules,
        cord.unstretched,
        record.pocket,
        device.cord.ferrule_length,
        record.lead,
    )


def join_names(names: Sequence[object]) -> str:
    """Join names as in "a, b and c"."""
    texts = [str(n) for n in names]
    return " and ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)


def cord_label(cord: str) -> str:
    """Return "cord A" for `A`, but "cord-1" for `cord-1`."""
    return cord if cord.lower().startswith("cord") else f"cord {cord}"


def label_parts(parts: Sequence[str]) -> str:
    """Return "part 1 (left)", or "parts 1 (left) + 2 (right)" for parts that are joined."""
    return f"part{'s' * (len(parts) > 1)} " + " + ".join(part_label(p) for p in parts)


def describe_sides(joint: JoinStep) -> str:
    """Describe the parts on both sides of a joint, as in "part 1 (left) and part 2 (right)"."""
    return f"{label_parts(joint.join[0])} and {label_parts(joint.join[1])}"


def pin_letters(joint: JoinStep) -> tuple[str, ...]:
    """Return a letter for each pin of a joint, by which texts and pictures name it.

    After z the names have two letters: aa, ab and so on, like the columns of a spreadsheet.
    """
    singles = string.ascii_lowercase
    pairs = (a + b for a in singles for b in singles)
    return tuple(islice(chain(singles, pairs), len(joint.pins)))


def format_resistance(ohm: float) -> str:
    """Format a resistance with its limits, as in "about 1146 ohm (1031 to 1260)"."""
    low, high = (1 - BATCH_TOLERANCE) * ohm, (1 + BATCH_TOLERANCE) * ohm
    return f"about {ohm:.0f} ohm ({low:.0f} to {high:.0f})"
