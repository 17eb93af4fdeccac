"""Load the parts and the guide of the last build, and describe them in markdown."""

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

_MAX_COLUMNS = 5  # columns that fit into the panel
_BUILD_BUTTON = "*Build everything*"


@dataclass(frozen=True)
class Note:
    """A warning about the device.

    Attributes:
        text: The warning.
        point: Where it applies (3,) mm, or None.
    """

    text: str
    point: Float | None


@dataclass(frozen=True)
class BuiltDevice:
    """Results of a build.

    Attributes:
        manifest: The manifest of the parts.
        layout: The layout of the cords.
        parts: Surfaces of the parts in the assembled device, by name.
        steps: Steps of the guide.
        shifts: Displacement (3,) mm of each part in the exploded view.
        tables: The guide's tables.
        checks: The guide's table of checks.
        notes: Warnings of the build and the layout.
    """

    manifest: Manifest
    layout: LayoutRecord
    parts: Mapping[str, Surface]
    steps: tuple[GuideStep, ...]
    shifts: Mapping[str, Float]
    tables: tuple[GuideTable, ...]
    checks: GuideTable
    notes: tuple[Note, ...]


@dataclass(frozen=True)
class BuildState:
    """Which version of the device the parts belong to.

    Attributes:
        is_built: Whether there are parts.
        outdated_stage: Title of the first stage that is outdated, or None if the parts are up to
            date.
        error: Error of the last build, or None.
        changes: Options of the plates that have changed since the build; empty for none.
        options: Options of the command with which up-to-date parts were built; empty for none.
    """

    is_built: bool
    outdated_stage: str | None = None
    error: str | None = None
    changes: str = ""
    options: str = ""

    @property
    def code(self) -> str:
        """Identifier of the state: "not-built", "outdated", "other-options" or "up-to-date"."""
        if not self.is_built:
            return "not-built"
        if self.outdated_stage is not None:
            return "outdated"
        return "other-options" if self.options else "up-to-date"


def load_built(device: Device, folder: Path) -> BuiltDevice | None:
    """Load the results of a build.

    Args:
        device: The device.
        folder: Folder of the build.

    Returns:
        The results, or None if the build has no parts.

    Raises:
        StorageError: The build is damaged.
    """
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
        locate_notes(manifest, layout, parts),
    )


def locate_notes(
    manifest: Manifest, layout: LayoutRecord, parts: Mapping[str, Surface]
) -> tuple[Note, ...]:
    """Return the warnings of a build and its layout with their points.

    A warning that contains no point gets the middle of the parts, or of the cord, that it names.
    """
    cords = {s.name: s.points[len(s.points) // 2] for s in layout.sensors}
    middles = {name: s.bounds.mean(axis=0) for name, s in parts.items()}
    texts = dict.fromkeys((*manifest.warnings, *layout.warnings))  # each text once
    return tuple(Note(text, _locate(text, cords, middles)) for text in texts)


def _locate(text: str, cords: Mapping[str, Float], parts: Mapping[str, Float]) -> Float | None:
    points = parse_points(text)
    if points:
        return points[0]
    words = text.replace(":", " ").replace(",", " ").replace("'", " ").split()
    for points_by_name in (parts, cords):
        named = [point for name, point in points_by_name.items() if name in words]
        if named:
            return np.asarray(np.mean(named, axis=0))
    return None


def step_text(step: GuideStep, number: int) -> str:
    """Return a step of the guide in markdown.

    Args:
        step: The step.
        number: Its number in the guide, from 1.
    """
    lines = [f"- {escape_cell(line)}" for line in step.lines]
    return "\n".join([f"### {number}. {escape_cell(step.title)}", *lines])


def table_text(table: GuideTable) -> str:
    """Return a table of the guide in markdown; a wide table is transposed."""
    if not table.rows:
        return "no entries"
    rows = [table.header, *table.rows]
    if len(table.header) > _MAX_COLUMNS:
        rows = list(zip(*rows, strict=True))
    lines = ["| " + " | ".join(escape_cell(cell) for cell in row) + " |" for row in rows]
    lines.insert(1, "|" + "---|" * len(rows[0]))
    return "\n".join(lines)


def state_text(state: BuildState) -> str:
    """Return which version of the device the parts belong to, and what to do, in markdown."""
    failure = "" if state.error is None else f" The last build failed: {html.escape(state.error)}."
    if not state.is_built:
        return f"**The device is not built yet.**{failure} Press {_BUILD_BUTTON}."
    if state.outdated_stage is None:
        text = "The parts are up to date."
        if state.options:
            text += (
                f" Their plates were built with `{state.options}`; {_BUILD_BUTTON} uses the values"
                " of device.toml. To keep these options, set them there under [fabrication]."
            )
        return text
    changes = f" ({state.changes})" if state.changes else ""
    return (
        f"**The device has changed since the parts were built**{changes}. The first outdated stage"
        f" is '{state.outdated_stage}'.{failure} Press {_BUILD_BUTTON}; the parts stay until then."
    )
