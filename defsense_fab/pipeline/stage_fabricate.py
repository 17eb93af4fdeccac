"""Stage 5: grooved parts, the assembly, the cut list."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.arrays import Float
from ..core.device import Device, Sensor
from ..core.errors import FabricationError
from ..core.files import write_json
from ..core.mesh import Surface
from ..geometry import facets, ray
from ..geometry.division import Division, channel_line, divide
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
    surface = load_surface(folder)
    ends = [
        _overrun(s, (a, b), surface, 2 * device.channel_diameter)
        for s, (a, b) in zip(sensors, inlets, strict=True)
    ]
    report(0.1, "cutting facets")
    body = facets.to_manifold(surface, "the body")
    cords = [(s.plane, channel_line(s, e)) for s, e in zip(sensors, ends, strict=True)]
    division = divide(body, cords, device.channel_diameter)
    parts, warnings = [], []
    for piece in division.parts:
        s = facets.printable(piece, "a part")
        parts.append(Part(s, float(piece.volume()), facets.centroid(s)))
    removed, body_volume = division.removed, float(body.volume())
    if is_cad(folder):
        report(0.3, "cutting the solid")
        try:
            solids, *volumes = _by_occ(folder, sensors, ends, division, device)
            parts = _matched(parts, solids)
            removed, body_volume = volumes
        except FabricationError as error:  # the STL do not need it
            warnings.append(f"no STEP parts: {error}")
    total = sum(p.volume for p in parts) + removed
    if abs(total / body_volume - 1) > CONSERVATION:
        raise FabricationError(
            f"parts and grooves add up to {total:.1f} mm^3 but the body has {body_volume:.1f};"
            " the cut failed: move a cord plane slightly"
        )
    order = sorted(range(len(parts)), key=lambda i: tuple(np.round(parts[i].center[[2, 1, 0]], 3)))
    names = [f"part-{order.index(i) + 1}" for i in range(len(parts))]
    steps = [
        {
            "join": [[names[i] for i in side] for side in cut.sides],
            "cords": [sensors[i].name for i in cut.cords],
        }
        for cut in reversed(division.cuts)
    ]
    named = {names[i]: parts[i] for i in order}
    out = folder / "parts"
    out.mkdir()
    report(0.7, "writing parts")
    for name, part in named.items():
        write_stl(part.surface, out / f"{name}.stl")
        if part.solid is not None:
            from ..geometry import occ

            occ.write_step(part.solid, out / f"{name}.step", name)
    surfaces = {name: part.surface for name, part in named.items()}
    write_3mf(surfaces, out / "assembly.3mf", device.name)
    manifest = _manifest(device, folder, named, removed, body_volume, warnings)
    write_json(out / "manifest.json", manifest | {"assembly": steps})


def _overrun(
    sensor: Sensor, inlets: tuple[float, float], surface: Surface, most: float
) -> tuple[float, float]:
    """How far the channel's tool runs on from the path's ends: past the surface by up to `most`
    mm, but only half way to where the body begins again."""
    line = channel_line(sensor, (1.0, 1.0))
    out = []
    for end, before, inlet in ((line[0], line[1], inlets[0]), (line[-1], line[-2], inlets[1])):
        exit_at = end + (inlet - 1.0) * (end - before)
        again = ray.hits(exit_at, end - before, surface)
        gap = again[again > 0.1]
        out.append(inlet + min(most, gap[0] / 2 if len(gap) else most))
    return out[0], out[1]


def _by_occ(
    folder: Path,
    sensors: Sequence[Sensor],
    ends: Sequence[tuple[float, float]],
    division: Division,
    device: Device,
) -> tuple[list[Any], float, float]:
    from ..geometry import occ

    solid = occ.read_step(folder / "body" / "body.step")[0]
    tubes = [
        occ.tube(s.plane, s.curve, *e, device.channel_diameter)
        for s, e in zip(sensors, ends, strict=True)
    ]
    pieces, removed = occ.carve_and_split(
        solid, tubes, [(c.plane, c.center) for c in division.cuts], len(division.parts)
    )
    return pieces, removed, occ.volume(solid)


def _matched(parts: Sequence[Part], solids: Sequence[Any]) -> list[Part]:
    """Each part of the facet kernel with its solid: the two kernels must tell the same story."""
    from ..geometry import occ

    left = [(s, occ.volume(s), occ.centroid(s)) for s in solids]
    total = sum(v for _, v, _ in left)
    out = list(parts)
    found = 0
    for k in sorted(range(len(parts)), key=lambda k: -parts[k].volume):
        part = parts[k]
        near = [
            (float(np.linalg.norm(c - part.center)) + abs(v - part.volume) / total, i)
            for i, (_, v, c) in enumerate(left)
        ]
        i = min(near)[1] if near else -1
        if i < 0 or abs(left[i][1] - part.volume) > 2e-3 * part.volume + 1e-4 * total:
            break
        solid, volume, center = left.pop(i)
        out[k] = Part(part.surface, volume, center, solid)
        found += 1
    if left or found != len(parts):
        raise FabricationError(
            f"the two geometry kernels disagree ({len(parts)} and {len(solids)} parts); move a"
            " cord plane slightly"
        )
    return out


def _manifest(
    device: Device,
    folder: Path,
    parts: Mapping[str, Part],
    removed: float,
    body_volume: float,
    warnings: Sequence[str],
) -> dict[str, Any]:
    layout = read_json(folder / "layout.json")["sensors"]
    warned = list(warnings)
    for name, part in parts.items():
        size = np.ptp(part.surface.bounds, axis=0)
        if part.volume < Limits.smallest_part * body_volume:
            warned.append(f"{name} is small ({part.volume:.0f} mm^3): two cord planes lie close")
        if not any(
            (np.array(turn) <= device.fabrication.bed).all()
            for turn in itertools.permutations(size)
        ):
            warned.append(f"{name} does not fit the bed of {device.fabrication.process}")
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
            warned.append(
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
            for name, part in parts.items()
        ],
        "cords": cords,
        "removed_volume": removed,
        "body_volume": body_volume,
        "warnings": warned,
    }
