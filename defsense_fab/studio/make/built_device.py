"""What the last build left to make the device with."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float, parse_points
from ...core.device.device import Device
from ...core.mesh import Surface
from ...report.guide.assembly.steps import GuideStep, exploded_shifts, guide_steps
from ...report.guide.tables import GuideTable, guide_checks, guide_tables
from ...store.layout import LayoutRecord, load_layout
from ...store.manifest import MANIFEST, Manifest, load_manifest, load_parts
from ..workbench.page_tables import escape_cell

# What the page says of a built device.

_WIDE = 5  # columns that the panel has room for


def step_words(step: GuideStep, number: int) -> str:
    """Markdown: the step as the guide has it."""
    return "\n".join(
        [f"### {number}. {escape_cell(step.title)}", *(f"- {escape_cell(x)}" for x in step.lines)]
    )


def table_words(table: GuideTable) -> str:
    """Markdown; a table of many columns is turned, so that each row of it is a column."""
    rows = [table.header, *table.rows]
    if not table.rows:
        return "nothing"
    if len(table.header) > _WIDE:
        rows = list(zip(*rows, strict=True))
    lines = ["| " + " | ".join(escape_cell(x) for x in row) + " |" for row in rows]
    lines.insert(1, "|" + "---|" * len(rows[0]))
    return "\n".join(lines)


def state_words(built: bool, outdated: str | None, problem: str | None, otherwise: str = "") -> str:
    """Markdown: of which device the parts are. `outdated` is the title of the stage that has still
    to be done for the device as it is now, `problem` that of the last build; `otherwise` is what
    has changed on the plates since then or, of parts that are up to date, the options that they
    were asked for with."""
    failed = "" if problem is None else f" The last build did not end: {html.escape(problem)}."
    if not built:
        return f"**Nothing is built yet.**{failed} Press *Build everything*."
    if outdated is None:
        asked = (
            f" Their plates are as `{otherwise}` asked for; *Build everything* makes those of"
            " device.toml: state it there, under [fabrication], to keep it."
        )
        asked = asked if otherwise else ""
        return f"The parts are those of the device as it is now.{asked}"
    changed = f" ({otherwise})" if otherwise else ""
    return (
        f"**The parts are those of an older device**: since then it has changed{changed}, and"
        f" '{outdated}' has still to be done.{failed} Press *Build everything*; until then these"
        " stay."
    )


@dataclass(frozen=True)
class Note:
    """What is to be said of the device, and where (3,) mm that is, if anywhere."""

    text: str
    place: Float | None


@dataclass(frozen=True)
class BuiltDevice:
    """The parts by name where they belong, the steps of the guide in its words, the directions
    (3,) mm in which the parts are drawn apart, the guide's tables, notes."""

    manifest: Manifest
    layout: LayoutRecord
    parts: Mapping[str, Surface]
    steps: tuple[GuideStep, ...]
    apart: Mapping[str, Float]
    tables: tuple[GuideTable, ...]
    checks: GuideTable
    notes: tuple[Note, ...]


def load_built(device: Device, folder: Path) -> BuiltDevice | None:
    """Of a build's `folder`; None where it has no parts. Raises StorageError where it is
    damaged."""
    if not (folder / MANIFEST).exists():
        return None
    manifest, layout = load_manifest(folder), load_layout(folder)
    parts = load_parts(folder, manifest)
    return BuiltDevice(
        manifest,
        layout,
        parts,
        guide_steps(device, manifest, parts),
        exploded_shifts(manifest, parts),
        guide_tables(manifest),
        guide_checks(manifest),
        notes(manifest, layout, parts),
    )


def notes(
    manifest: Manifest, layout: LayoutRecord, parts: Mapping[str, Surface]
) -> tuple[Note, ...]:
    """What build and layout warn of. Where no place is told, it is that of the parts or the cord
    that are named."""
    cords = {s.name: s.points[len(s.points) // 2] for s in layout.sensors}
    middles = {name: s.bounds.mean(axis=0) for name, s in parts.items()}
    told = dict.fromkeys((*manifest.warnings, *layout.warnings))
    return tuple(Note(text, _place(text, cords, middles)) for text in told)


def _place(text: str, cords: Mapping[str, Float], parts: Mapping[str, Float]) -> Float | None:
    told = parse_points(text)
    if told:
        return told[0]
    words = text.replace(":", " ").replace(",", " ").replace("'", " ").split()
    for known in (parts, cords):
        named = [place for name, place in known.items() if name in words]
        if named:
            return np.asarray(np.mean(named, axis=0))
    return None
