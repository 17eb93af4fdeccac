"""The parts and the assembly guide of a build as the page gets them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ....core.arrays import Float
from ....core.curve import resample
from ....core.device.device import Device
from ....workflow.build.part_changes import load_changes
from ....workflow.fabrication.assembly_guide import (
    PART_COLORS,
    AssemblyGuide,
    GuideTable,
    Joint,
    glueless_lines,
    step_view,
)
from ....workflow.view import Arrays
from ...messages import make as messages
from ...session.body_arrays import surface_arrays
from ...session.cord_colors import CORD_COLORS
from ...session.cord_states import rounded

FILES_PATH = "files/make/"  # of files of the build, on the server
PLATES_FOLDER = "parts"
_FILES = (
    ("Assembly guide", "guide.html"),
    ("Report", "report.html"),
    ("Templates at 1:1", "templates.pdf"),
    ("Wiring", "wiring.svg"),
)
_MAX_PATH_POINTS = 120


def parts_state(guide: AssemblyGuide, identifier: str) -> messages.Parts:
    """Return the parts as the page gets them."""
    plates = {name: plate.file for plate in guide.manifest.plates for name in plate.parts}
    records = {part.name: part for part in guide.manifest.parts}
    return messages.Parts(
        id=identifier,
        parts=[
            messages.PartState(
                name=name,
                color=PART_COLORS[k % len(PART_COLORS)],
                volume=records[name].volume,
                size=rounded(np.ptp(surface.bounds, axis=0)),
                plate=plates.get(name, ""),
                shift=rounded(guide.shifts[name]),
            )
            for k, (name, surface) in enumerate(guide.parts.items())
        ],
    )


def part_meshes(guide: AssemblyGuide, identifier: str) -> Arrays:
    """Return the surfaces of the parts."""
    arrays: dict[str, object] = {}
    for k, surface in enumerate(guide.parts.values()):
        for name, values in surface_arrays(surface).items():
            arrays[f"{k}/{name}"] = values
    return Arrays(name="parts", arrays=arrays, facts={"id": identifier, "names": list(guide.parts)})


def guide_state(
    device: Device,
    guide: AssemblyGuide,
    identifier: str,
    folder: Path,
    colors: Mapping[str, str],
) -> messages.Guide:
    """Return the guide as the page gets it.

    Args:
        device: The device.
        guide: The guide.
        identifier: Identifier of the build's parts.
        folder: Folder of the build.
        colors: Colors of the drawn cords by name.
    """
    cords = [
        messages.BuiltCordState(
            name=cord.name,
            color=colors.get(cord.name, CORD_COLORS[k % len(CORD_COLORS)]),
            path=_shown_line(cord.points),
        )
        for k, cord in enumerate(guide.layout.sensors)
    ]
    return messages.Guide(
        id=identifier,
        cord_radius=device.cord.diameter / 2,
        wire_radius=device.fabrication.wire_diameter / 2,
        cords=cords,
        stages=[_stage(device, guide, k) for k in range(len(guide.steps))],
        lists=[_list(table) for table in (*_changes(folder), *guide.tables)],
        checks=_list(guide.checks),
        notes=[
            messages.GuideNote(
                text=note.text, point=None if note.point is None else rounded(note.point)
            )
            for note in guide.notes
        ],
        files=build_files(guide, folder),
    )


def _changes(folder: Path) -> list[GuideTable]:
    """Return the table of what differs from the parts before these; empty if there were none."""
    changes = load_changes(folder)
    if changes is None:
        return []
    header = ("piece", "what to do")
    return [GuideTable("Compared with the build before", header, tuple(changes.rows()))]


def build_files(guide: AssemblyGuide, folder: Path) -> list[messages.MadeFile]:
    """Return the files of a build that can be saved, those that exist."""
    plates = [plate.file for plate in guide.manifest.plates]
    numbered = {
        f"{PLATES_FOLDER}/{file}": "Print plate" if len(plates) == 1 else f"Print plate {k}"
        for k, file in enumerate(plates, start=1)
    }
    named = [(title, name) for name, title in numbered.items()] + list(_FILES)
    return [
        made_file(title, folder / name, name)
        for title, name in named
        if (folder / name).is_file() and (folder / name).resolve().is_relative_to(folder.resolve())
    ]


def made_file(title: str, file: Path, name: str) -> messages.MadeFile:
    """Return a file with its address on the server."""
    return messages.MadeFile(
        title=title, name=file.name, path=FILES_PATH + name, size=file.stat().st_size
    )


def _stage(device: Device, guide: AssemblyGuide, index: int) -> messages.GuideStage:
    step, view = guide.steps[index], step_view(guide, index)
    names = tuple(cord.name for cord in guide.layout.sensors)
    cords = names if view in ("cords", "assembled") else ()
    if step.joint is not None:
        cords = step.joint.cords
    return messages.GuideStage(
        id=step.identifier,
        title=step.title,
        passages=[list(passage.lines) for passage in step.passages],
        view=view,
        cords=list(cords),
        joint=None if step.joint is None else _joint(device, guide, step.joint),
    )


def _joint(device: Device, guide: AssemblyGuide, joint: Joint) -> messages.GuideJoint:
    glueless = glueless_lines(device, guide.layout, guide.manifest, joint)
    return messages.GuideJoint(
        lower=list(joint.lower),
        upper=list(joint.upper),
        lift=rounded(joint.lift * joint.opens),
        wires=[_shown_line(wire) for wire in joint.wires],
        glueless=[_shown_line(line) for line in glueless],
        pins=[
            messages.GuidePin(
                letter=letter,
                start=rounded(pin.center - pin.depth * joint.opens),
                end=rounded(pin.center + pin.depth * joint.opens),
                radius=pin.socket / 2,
            )
            for letter, pin in zip(joint.letters, joint.pins, strict=True)
        ],
    )


def _list(table: GuideTable) -> messages.GuideList:
    return messages.GuideList(
        title=table.title, header=list(table.header), rows=[list(row) for row in table.rows]
    )


def _shown_line(line: Float) -> list[list[float]]:
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    if len(line) <= _MAX_PATH_POINTS or not length:
        return rounded(line)
    return rounded(resample(line, 0.0, length, _MAX_PATH_POINTS))
