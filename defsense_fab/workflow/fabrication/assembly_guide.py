"""The assembly guide of a built device: its parts, steps, tables and notes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from ...core.arrays import Float
from ...core.device.device import Device
from ...core.mesh import Surface
from ...report.guide.actions import ActionKind
from ...report.guide.steps import GuideStep as GuideStep
from ...report.guide.steps import Joint as Joint
from ...report.guide.steps import exploded_shifts, guide_steps
from ...report.guide.tables import GuideTable as GuideTable
from ...report.guide.tables import guide_checks, guide_tables
from ...report.guide.templates import glueless_lines as glueless_lines
from ...report.pictures.sheet import COLORS
from ...store.build import Build
from ...store.layout import LayoutRecord
from ...store.manifest import Manifest
from .effort import effort_table

#: Colors of the parts in the guide's pictures, as "#rrggbb", in the order of the parts.
PART_COLORS: tuple[str, ...] = tuple(COLORS)

#: What a picture of a step shows: what is printed, the exploded parts, the cords on the bench, the
#: open joint, or the assembled device.
StepView = Literal["plates", "exploded", "cords", "joint", "assembled"]
_PRINTED_KINDS = {ActionKind.PRINT, ActionKind.CAST}
_CORD_KINDS = {
    ActionKind.CUT,
    ActionKind.CRIMP,
    ActionKind.MARK,
    ActionKind.TRIM,
    ActionKind.MEASURE,
}


@dataclass(frozen=True)
class Note:
    """A warning about a built device.

    Attributes:
        text: The warning.
        point: Where it applies (3,) mm, or None.
    """

    text: str
    point: Float | None


@dataclass(frozen=True)
class AssemblyGuide:
    """A built device and the steps that assemble it.

    Attributes:
        manifest: The manifest of the parts.
        layout: The layout of the cords.
        parts: Surfaces of the parts in the assembled device, by name.
        steps: Steps of the assembly, in order.
        shifts: Displacement (3,) mm of each part in the exploded view.
        tables: What the device takes, and what to print, to cut and to buy.
        checks: Measurements of the parts with their limits.
        notes: Warnings of the parts and the layout, each once.
    """

    manifest: Manifest
    layout: LayoutRecord
    parts: Mapping[str, Surface]
    steps: tuple[GuideStep, ...]
    shifts: Mapping[str, Float]
    tables: tuple[GuideTable, ...]
    checks: GuideTable
    notes: tuple[Note, ...]


def assembly_guide(device: Device, build: Build) -> AssemblyGuide:
    """Return the assembly guide of a build.

    Args:
        device: The device.
        build: Its build, with parts.

    Raises:
        StorageError: A result of the build is missing or damaged.
    """
    manifest, layout, parts = build.manifest, build.layout, build.parts
    return AssemblyGuide(
        manifest,
        layout,
        parts,
        guide_steps(device, manifest, parts),
        exploded_shifts(manifest, parts),
        (effort_table(device, manifest), *guide_tables(manifest)),
        guide_checks(manifest),
        _notes(manifest, layout),
    )


def step_view(guide: AssemblyGuide, index: int) -> StepView:
    """Return what a picture of the step with an index shows."""
    step = guide.steps[index]
    kinds = {action.kind for passage in step.passages for action, _ in passage.actions}
    if step.joint is not None:
        return "joint"
    if kinds and kinds <= _PRINTED_KINDS:
        return "plates"
    if any(earlier.joint is not None for earlier in guide.steps[:index]):
        return "assembled"
    return "cords" if kinds and kinds <= _CORD_KINDS else "exploded"


def _notes(manifest: Manifest, layout: LayoutRecord) -> tuple[Note, ...]:
    texts = dict.fromkeys((*manifest.warnings, *layout.warnings))  # each text once
    middles = layout.middles
    places = {text: middles.get(cord) for text, cord in layout.warned_cords.items()}
    places |= manifest.places
    return tuple(Note(text, places.get(text)) for text in texts)
