"""The assembly guide: parts to print, cords to cut, what to buy, steps with pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.mesh import Surface
from ...core.storage.files import write_json
from ...store.layout import LayoutRecord
from ...store.manifest import Manifest
from ..pictures.part_pictures import exploded
from .assembly.actions import Action
from .assembly.steps import GuideStep, Joint, guide_steps, order_of, shifts
from .assembly.wording import ENDS
from .joint_pictures import Pictures
from .tables import GuideTable, guide_checks, guide_tables
from .templates import Face, Strip, face, strips

# The guide's steps as typed actions, for other programs: `guide.json` beside `guide.html`.

SCHEMA = 1
FILE = "guide.json"


def write_guide_file(guide: Guide, path: Path) -> None:
    """Steps in their order, each with its actions in theirs: what is `do`ne, of which `cord`, `end`
    and `joint` (index of the manifest's `assembly`), by how many `mm`, what `ohm` it should
    measure, and the `lines` in which guide.html says it. Raises StorageError."""
    steps = plain_steps(guide.typed)
    write_json(path, {"schema": SCHEMA, "title": guide.title, "steps": steps})


def plain_steps(steps: Sequence[GuideStep]) -> list[dict[str, Any]]:
    """As they stand in the file."""
    return [
        {
            "number": number,
            "title": step.title,
            "actions": [
                _plain(action, lines)
                for passage in step.passages
                for action, lines in passage.actions
            ],
        }
        for number, step in enumerate(steps, start=1)
    ]


def _plain(action: Action, lines: tuple[str, ...]) -> dict[str, Any]:
    out: dict[str, Any] = {"do": str(action.kind)}
    if action.joint is not None:
        out["joint"] = action.joint
    if action.cord is not None:
        out["cord"] = action.cord
    if action.end is not None:
        out["end"] = ENDS[action.end]
    if action.amount is not None:
        out["mm"] = action.amount
    if action.expected:
        out["ohm"] = [
            {"cord": e.cord, "about": e.about, "low": e.low, "high": e.high}
            for e in action.expected
        ]
    out["lines"] = list(lines)
    return out


@dataclass(frozen=True)
class ShownPassage:
    """Sentences, and a picture (PNG as a data URI) or none."""

    lines: tuple[str, ...]
    picture: str | None = None


@dataclass(frozen=True)
class AssemblyStep:
    """A title, and its passages in their order."""

    title: str
    passages: tuple[ShownPassage, ...]


@dataclass(frozen=True)
class Guide:
    """All that the guide says, for either format; `typed` are the same steps as typed actions;
    `strips` and `faces` are drawn at 1:1."""

    title: str
    intro: str
    warnings: tuple[str, ...]
    exploded: str
    tables: tuple[GuideTable, ...]
    steps: tuple[AssemblyStep, ...]
    checks: GuideTable
    typed: tuple[GuideStep, ...]
    strips: tuple[Strip, ...]
    faces: tuple[Face, ...]


def assembly_guide(
    device: Device,
    layout: LayoutRecord,
    manifest: Manifest,
    parts: Mapping[str, Surface],
    frame: Float,
    notes: Sequence[str] = (),
) -> Guide:
    """The guide of a device with its parts by name; `frame` (3, 3) says how its body stands, and
    `notes` what there is to say of its poses."""
    pictures = Pictures(device, layout, manifest, parts)
    steps, problem = guide_steps(device, manifest, parts), order_of(manifest)[1]
    return Guide(
        title=f"{device.name}: assembly guide",
        intro=f"{len(manifest.parts)} parts,"
        f" {len(manifest.cords)} cord{'s' * (len(manifest.cords) > 1)}. All lengths in mm."
        + _of_copies(manifest.copies),
        warnings=(
            *notes,
            *layout.warnings,
            *manifest.warnings,
            *([] if problem is None else [problem]),
        ),
        exploded=exploded(parts, shifts(manifest, parts), frame),
        tables=guide_tables(manifest),
        steps=tuple(
            AssemblyStep(
                s.title, tuple(ShownPassage(p.lines, pictures.of(s, p)) for p in s.passages)
            )
            for s in steps
        ),
        checks=guide_checks(manifest),
        typed=steps,
        strips=strips(device, manifest),
        faces=tuple(
            found
            for number, step in enumerate(steps, start=1)
            if step.joint is not None
            for found in [_face(number, step.joint, device, layout, manifest, parts)]
            if found is not None
        ),
    )


def _of_copies(copies: int) -> str:
    if copies == 1:
        return ""
    return (
        f" Plates and bill are for {copies} devices, the cut list and the steps for each of them:"
        " cut and do everything as often."
    )


def _face(
    number: int,
    joint: Joint,
    device: Device,
    layout: LayoutRecord,
    manifest: Manifest,
    parts: Mapping[str, Surface],
) -> Face | None:
    title = f"Step {number}: the face of {' + '.join(joint.lower)}"
    return face(joint, title, device, layout, manifest, parts)
