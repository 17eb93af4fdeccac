"""Stage 5: grooved parts, the assembly, the cut list."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.arrays import Float
from ..core.curve import Plane, distinct
from ..core.device import Device, Sensor
from ..core.errors import FabricationError
from ..core.files import write_json
from ..core.mesh import Surface
from ..geometry import facets
from ..geometry.export import write_3mf, write_stl
from ..optimize.problem import Limits
from .stage_body import is_cad, load_surface
from .stage_optimize import load_sensors
from .stages import Report, read_json

#: Largest relative difference between the body and its parts plus what was removed.
CONSERVATION = 1e-3


@dataclass(frozen=True)
class Part:
    """One printable piece; `solid` is its TopoDS_Solid where the body is CAD."""

    surface: Surface
    volume: float
    center: Float
    solid: Any = None


def run(device: Device, folder: Path, report: Report) -> None:
    sensors = load_sensors(folder)
    inlets = [s["inlets"] for s in read_json(folder / "layout.json")["sensors"]]
    overrun = 2 * device.channel_diameter
    ends = [(a + overrun, b + overrun) for a, b in inlets]
    planes = distinct([s.plane for s in sensors])
    surface = load_surface(folder)
    report(0.1, "cutting facets")
    parts, removed, body_volume = _by_facets(surface, sensors, ends, planes, device)
    if is_cad(folder):
        report(0.3, "cutting the solid")
        solids, removed, body_volume = _by_occ(folder, sensors, ends, planes, device)
        parts = _matched(parts, solids)
    total = sum(p.volume for p in parts) + removed
    if abs(total / body_volume - 1) > CONSERVATION:
        raise FabricationError(
            f"parts and grooves add up to {total:.1f} mm^3 but the body has {body_volume:.1f};"
            " the cut failed: move a cord plane slightly"
        )
    parts = sorted(parts, key=lambda p: tuple(np.round(p.center[[2, 1, 0]], 3)))
    out = folder / "parts"
    out.mkdir()
    report(0.7, "writing parts")
    names = [f"part-{i + 1}" for i in range(len(parts))]
    for name, part in zip(names, parts, strict=True):
        write_stl(part.surface, out / f"{name}.stl")
        if part.solid is not None:
            from ..geometry import occ

            occ.write_step(part.solid, out / f"{name}.step", name)
    write_3mf(
        dict(zip(names, (p.surface for p in parts), strict=True)),
        out / "assembly.3mf",
        device.name,
    )
    write_json(out / "manifest.json", _manifest(device, folder, names, parts, removed, body_volume))


def channel_line(sensor: Sensor, ends: tuple[float, float]) -> Float:
    """The channel's centre line (p, 3) mm with its straight runs out of the body."""
    points = sensor.plane.to_world(sensor.curve.sample(24))
    tangents = sensor.curve.tangents @ sensor.plane.axes[:, :2].T
    first, last = (t / np.linalg.norm(t) for t in (tangents[0], tangents[-1]))
    return np.concatenate([points[:1] - ends[0] * first, points, points[-1:] + ends[1] * last])


def _by_facets(
    surface: Surface,
    sensors: Sequence[Sensor],
    ends: Sequence[tuple[float, float]],
    planes: Sequence[Plane],
    device: Device,
) -> tuple[list[Part], float, float]:
    body = facets.to_manifold(surface, "the body")
    tubes = [
        facets.tube(channel_line(s, e), s.plane.normal, device.channel_diameter)
        for s, e in zip(sensors, ends, strict=True)
    ]
    pieces, removed = facets.carve_and_split(body, tubes, planes)
    parts = []
    for piece in pieces:
        s = facets.printable(piece, "a part")
        parts.append(Part(s, float(piece.volume()), _centroid(s)))
    return parts, removed, float(body.volume())


def _centroid(surface: Surface) -> Float:
    """Centre of mass (3,) mm: each facet and the origin span a tetrahedron."""
    corners = surface.vertices[surface.faces]
    volume = np.linalg.det(corners)
    return np.asarray(volume @ corners.sum(1) / (4 * volume.sum()))


def _by_occ(
    folder: Path,
    sensors: Sequence[Sensor],
    ends: Sequence[tuple[float, float]],
    planes: Sequence[Plane],
    device: Device,
) -> tuple[list[Any], float, float]:
    from ..geometry import occ

    solid = occ.read_step(folder / "body" / "body.step")[0]
    tubes = [
        occ.tube(s.plane, s.curve, *e, device.channel_diameter)
        for s, e in zip(sensors, ends, strict=True)
    ]
    pieces, removed = occ.carve_and_split(solid, tubes, planes)
    return pieces, removed, occ.volume(solid)


def _matched(parts: Sequence[Part], solids: Sequence[Any]) -> list[Part]:
    """Each part of the facet kernel with its solid: the two kernels must tell the same story."""
    from ..geometry import occ

    left = [(s, occ.volume(s), occ.centroid(s)) for s in solids]
    total = sum(v for _, v, _ in left)
    out = []
    for part in sorted(parts, key=lambda p: -p.volume):
        near = [
            (float(np.linalg.norm(c - part.center)) + abs(v - part.volume) / total, i)
            for i, (_, v, c) in enumerate(left)
        ]
        i = min(near)[1] if near else -1
        if i < 0 or abs(left[i][1] - part.volume) > 2e-3 * part.volume + 1e-4 * total:
            break
        solid, volume, center = left.pop(i)
        out.append(Part(part.surface, volume, center, solid))
    if left or len(out) != len(parts):
        raise FabricationError(
            f"the two geometry kernels disagree ({len(parts)} and {len(solids)} parts); move a"
            " cord plane slightly"
        )
    return out


def _manifest(
    device: Device,
    folder: Path,
    names: Sequence[str],
    parts: Sequence[Part],
    removed: float,
    body_volume: float,
) -> dict[str, Any]:
    layout = read_json(folder / "layout.json")["sensors"]
    warnings = []
    for name, part in zip(names, parts, strict=True):
        size = np.ptp(part.surface.bounds, axis=0)
        if part.volume < Limits.smallest_part * body_volume:
            warnings.append(f"{name} is small ({part.volume:.0f} mm^3): two cord planes lie close")
        if not any(
            (np.array(turn) <= device.fabrication.bed).all()
            for turn in itertools.permutations(size)
        ):
            warnings.append(f"{name} does not fit the bed of {device.fabrication.process}")
    cords = []
    for s in layout:
        cut = s["length"] + sum(s["inlets"]) + 2 * device.fabrication.lead
        cords.append(
            {
                "sensor": s["name"],
                "cut_length": cut,
                "lead": device.fabrication.lead,
                "channel_diameter": device.channel_diameter,
                "resistance": cut * device.cord.ohm_per_mm,
            }
        )
        if s["peak_strain"] > device.cord.max_strain:
            warnings.append(
                f"cord {s['name']} is stretched by {s['peak_strain']:.0%}, more than its"
                f" {device.cord.max_strain:.0%}"
            )
    return {
        "schema": 1,
        "device": device.name,
        "unit": "mm",
        "parts": [
            {
                "name": name,
                "stl": f"{name}.stl",
                "step": f"{name}.step" if part.solid is not None else None,
                "volume": part.volume,
                "bbox": part.surface.bounds.tolist(),
            }
            for name, part in zip(names, parts, strict=True)
        ],
        "cords": cords,
        "removed_volume": removed,
        "body_volume": body_volume,
        "warnings": warnings,
    }
