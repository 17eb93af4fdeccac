"""The assembly guide: parts to print, cords to cut, what to buy, steps with pictures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ...core.arrays import Float
from ...core.device import Device
from ...core.mesh import Surface
from ..artifacts.layout import LayoutRecord
from ..artifacts.manifest import Manifest
from .colors import COLORS
from .guide_steps import Joint, guide_steps, shifts
from .guide_tables import GuideTable, guide_checks, guide_tables
from .pictures.parts import exploded, joining


@dataclass(frozen=True)
class AssemblyStep:
    """A title, sentences, and a picture (PNG as a data URI) or none."""

    title: str
    lines: tuple[str, ...]
    picture: str | None = None


@dataclass(frozen=True)
class Guide:
    """All that the guide says, for either format."""

    title: str
    intro: str
    warnings: tuple[str, ...]
    exploded: str
    tables: tuple[GuideTable, ...]
    steps: tuple[AssemblyStep, ...]
    checks: GuideTable


def assembly_guide(
    device: Device,
    layout: LayoutRecord,
    manifest: Manifest,
    parts: Mapping[str, Surface],
    frame: Float,
) -> Guide:
    """The guide of a device with its parts by name; `frame` (3, 3) says how its body stands."""
    paths = {s.name: s.points for s in layout.sensors}
    return Guide(
        title=f"{device.name}: assembly guide",
        intro=f"{len(manifest.parts)} parts, {len(manifest.cords)} cords. All lengths in mm.",
        warnings=tuple(manifest.warnings),
        exploded=exploded(parts, shifts(manifest, parts), frame),
        tables=guide_tables(manifest),
        steps=tuple(
            AssemblyStep(
                s.title,
                s.lines,
                None if s.joint is None else _picture(device, s.joint, paths, parts),
            )
            for s in guide_steps(device, manifest, parts)
        ),
        checks=guide_checks(manifest),
    )


def _picture(
    device: Device, joint: Joint, paths: Mapping[str, Float], parts: Mapping[str, Surface]
) -> str:
    colors = {n: COLORS[i % len(COLORS)] for i, n in enumerate(parts)}
    return joining(
        {n: parts[n] for n in joint.lower},
        {n: parts[n] for n in joint.upper},
        colors,
        joint.opens,
        joint.lift,
        [(paths[c], "#222222", device.cord.diameter / 2) for c in joint.cords]
        + [(w, "#c1121f", device.fabrication.wire_diameter / 2) for w in joint.wires],
        [(p.center, p.socket, 2 * p.depth) for p in joint.pins],
    )
