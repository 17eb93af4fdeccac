"""What the last build left to make the device with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float, parse_points
from ...core.device.device import Device
from ...core.mesh import Surface
from ...report.guide.hands.steps import GuideStep, guide_steps, shifts
from ...report.guide.tables import GuideTable, guide_checks, guide_tables
from ...store.layout import LayoutRecord, load_layout
from ...store.manifest import MANIFEST, Manifest, load_manifest, load_parts


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
        shifts(manifest, parts),
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
