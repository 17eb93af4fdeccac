"""Collect the content of the assembly guide, and write its files."""

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
from ...store.manifest import END_NAMES, Manifest
from ..html import as_svg_image, write_page
from ..pictures.part_pictures import exploded
from ..wiring.connections import Wiring
from ..wiring.drawing import draw_wiring
from .actions import Action, ActionKind
from .instructions import label_parts
from .joint_pictures import JointPictures
from .pad_drawing import draw_pad
from .steps import GuideStep, Passage, assembly_order, exploded_shifts, guide_steps
from .tables import GuideTable, guide_checks, guide_tables, wiring_tables
from .template_pages import write_templates
from .templates import CordTemplate, FaceTemplate, cord_templates, face_template

_SCHEMA = 1  # version of the format of guide.json


@dataclass(frozen=True)
class WiringSection:
    """How the cords are connected to the board.

    Attributes:
        drawing: The drawing as a data URI.
        tables: Tables of the wires of each cord, and of all other wires.
        notes: What to know about the wiring, as sentences.
    """

    drawing: str
    tables: tuple[GuideTable, GuideTable]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Guide:
    """Content of the assembly guide.

    Attributes:
        device: Name of the device.
        intro: One paragraph below the title.
        warnings: Warnings about poses, layout, parts and assembly.
        exploded: Exploded view as a PNG data URI.
        tables: Tables of what to print, cut and buy.
        steps: Steps in their order.
        pictures: For each passage of each step its picture as a data URI, or None.
        checks: Table of the measurements of the parts.
        strips: Templates of the cords at 1:1.
        faces: Templates of the joints' faces at 1:1.
        forces: A line on the force of each pose.
        accuracy: The expected error, with its grade and their scale.
        wiring: How the cords are connected; None if the board cannot read them.
        effort: Table of what the device takes, with the basis of each figure.
    """

    device: str
    intro: str
    warnings: tuple[str, ...]
    exploded: str
    tables: tuple[GuideTable, ...]
    steps: tuple[GuideStep, ...]
    pictures: tuple[tuple[str | None, ...], ...]
    checks: GuideTable
    strips: tuple[CordTemplate, ...]
    faces: tuple[FaceTemplate, ...]
    forces: tuple[str, ...] = ()
    accuracy: str = ""
    wiring: WiringSection | None = None
    effort: GuideTable | None = None

    @property
    def title(self) -> str:
        """Title of the page."""
        return f"{self.device}: assembly guide"


def assembly_guide(
    device: Device,
    layout: LayoutRecord,
    manifest: Manifest,
    parts: Mapping[str, Surface],
    frame: Float,
    notes: Sequence[str],
    wiring: Wiring | None = None,
) -> Guide:
    """Return the assembly guide of a device, with its pictures.

    Args:
        device: The device.
        layout: Layout of its cords.
        manifest: The manifest of its parts.
        parts: Surfaces of its parts, by name.
        frame: Axes (3, 3) to the right, up and towards the viewer, one a row.
        notes: Warnings about its poses and its board.
        wiring: Its wiring; None if the board cannot read all cords.

    Returns:
        The guide.
    """
    pictures = JointPictures(device, layout, manifest, parts)
    steps, order_problem = guide_steps(device, manifest, parts), assembly_order(manifest)[1]
    faces = [
        face_template(
            step.joint,
            f"Step {number}: the face of {label_parts(step.joint.lower)}",
            device,
            layout,
            manifest,
            parts,
        )
        for number, step in enumerate(steps, start=1)
        if step.joint is not None
    ]
    return Guide(
        device=device.name,
        intro=_write_intro(manifest),
        warnings=(
            *notes,
            *layout.warnings,
            *manifest.warnings,
            *([] if order_problem is None else [order_problem]),
        ),
        exploded=exploded(parts, exploded_shifts(manifest, parts), frame),
        tables=guide_tables(manifest),
        steps=steps,
        pictures=tuple(
            tuple(_draw_passage(device, pictures, step, p) for p in step.passages) for step in steps
        ),
        checks=guide_checks(manifest),
        strips=() if manifest.traces else cord_templates(device, manifest),
        faces=tuple(face for face in faces if face is not None),
        wiring=None if wiring is None else _describe_wiring(wiring),
    )


def _describe_wiring(wiring: Wiring) -> WiringSection:
    drawing = as_svg_image(draw_wiring(wiring))
    return WiringSection(drawing, wiring_tables(wiring), wiring.notes)


def _draw_passage(
    device: Device, pictures: JointPictures, step: GuideStep, passage: Passage
) -> str | None:
    """Return the picture of a passage; the first passage on pads has their drawing."""
    if device.pad is not None and passage.actions[0][0].kind is ActionKind.PADS:
        is_first = passage is step.passages[0]
        return as_svg_image(draw_pad(device.pad)) if is_first else None
    return pictures.draw(step, passage)


def _write_intro(manifest: Manifest) -> str:
    cord_count = len(manifest.cords)
    if manifest.traces:
        return (
            f"One part with {cord_count} printed trace{'s' * (cord_count > 1)}: nothing is cut"
            " or glued. All lengths are in mm."
        )
    intro = (
        f"{len(manifest.parts)} parts, {cord_count} cord{'s' * (cord_count > 1)}. All lengths are"
        " in mm."
    )
    if manifest.copies > 1:
        intro += (
            f" Plates and bill of materials are for {manifest.copies} devices. The cut list and the"
            " steps are for one device: repeat them for each."
        )
    return intro


def write_guide(guide: Guide, folder: Path, view3d: str = "") -> None:
    """Write the guide's page, its templates as PDF, and its steps for other programs.

    The files are `guide.html`, `templates.pdf` and `guide.json`, which has `schema`, `title` and
    `steps`; `plain_steps` describes a step.

    Args:
        guide: The guide.
        folder: The folder for the files.
        view3d: HTML of the device's 3D view.

    Raises:
        StorageError: A file cannot be written.
    """
    write_page(folder / "guide.html", "guide", guide=guide, view3d=view3d)
    title = f"{guide.device}: templates at 1:1"
    write_templates(folder / "templates.pdf", title, guide.strips, guide.faces)
    content = {"schema": _SCHEMA, "title": guide.title, "steps": plain_steps(guide.steps)}
    write_json(folder / "guide.json", content)


def plain_steps(steps: Sequence[GuideStep]) -> list[dict[str, Any]]:
    """Convert steps to the values of `guide.json`.

    Args:
        steps: The steps in their order.

    Returns:
        For each step its `number`, `title` and `actions`. An action has `do` (its kind) and
        `lines` (its instructions), and where they apply `joint` (index in the manifest's
        `assembly`), `cord`, `end`, `mm`, `ohm` (expected resistances) and
        `steady` (cords that must not jump).
    """
    return [
        {
            "number": number,
            "title": step.title,
            "actions": [
                _to_plain(action, lines)
                for passage in step.passages
                for action, lines in passage.actions
            ],
        }
        for number, step in enumerate(steps, start=1)
    ]


def _to_plain(action: Action, lines: tuple[str, ...]) -> dict[str, Any]:
    plain: dict[str, Any] = {"do": str(action.kind)}
    if action.joint is not None:
        plain["joint"] = action.joint
    if action.cord is not None:
        plain["cord"] = action.cord
    if action.end is not None:
        plain["end"] = END_NAMES[action.end]
    if action.amount is not None:
        plain["mm"] = action.amount
    if action.expected:
        plain["ohm"] = [
            {"cord": e.cord, "about": e.about, "low": e.low, "high": e.high}
            for e in action.expected
        ]
    if action.steady:
        plain["steady"] = list(action.steady)
    plain["lines"] = list(lines)
    return plain
