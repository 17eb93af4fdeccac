"""Stage 5: printable parts, the plates, the assembly, the cut list."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arrays import Float
from ...core.device import Device, Sensor
from ...core.errors import FabricationError
from ...core.files import write_json
from ...core.mesh import Surface
from ...core.prediction import Prediction
from ...geometry.channels.channel_ends import Pockets
from ...geometry.channels.cord_channels import Channel, channels_of
from ...geometry.channels.wire_channels import Wires
from ...geometry.kernels import triangle_kernel
from ...geometry.kernels.cutting_tools import Prism
from ...geometry.kernels.export import write_3mf, write_stl
from ...geometry.parts.parts import make_parts
from ...geometry.parts.print_bed import PlacedPart, arrange, laid
from ...geometry.parts.records import Made, Rules
from ...optimize.limits.verification import verify
from ...optimize.problem.cord_parameters import sample_path
from .cut_list import bill, cut_list
from .stage_body import is_cad, load_bay, load_surface
from .stage_optimize import limits, load_sensors, load_task, predict
from .stages import Report, read_json

#: The folder in parts/ of what lies as it is printed; beside it parts stand where they belong.
LYING = "print"
#: Predicted errors that grow by more than this with the pockets are told.
_WORSE = 1.05


def rules(device: Device, bay: Prism | None = None) -> Rules:
    """What the device's cord and process ask of its parts, whose wires end in the `bay`."""
    f = device.fabrication
    relief = f.strain_relief is not False
    wires = Wires(f.wire_diameter, f.wire_diameter + f.clearance, bay, relief)
    pocket = max(device.cord.ferrule_diameter + f.clearance, device.channel_diameter + 0.1)
    return Rules(
        device.cord.diameter,
        device.channel_diameter,
        f.clearance,
        f.wall,
        f.limit_cuts,
        Pockets(pocket, device.cord.ferrule_length, wires if bay or relief else None)
        if f.pockets
        else None,
        f.marker_seats,
        f.marker_size,
    )


def run(device: Device, folder: Path, report: Report) -> None:
    sensors = load_sensors(folder)
    surface = load_surface(folder)
    solid = None
    if is_cad(folder):
        from ...geometry.kernels import occ

        solid = occ.read_step(folder / "body" / "body.step")[0]
    layout, bay = read_json(folder / "layout.json"), load_bay(folder)
    decoder = layout["prediction"]["decoder"]
    device, note = _relief(device, folder, surface, sensors, bay, decoder)
    made = fabricate(device, surface, sensors, report, solid, bay)
    report(0.75, "predicting with joints")
    prediction = as_made(device, folder, made.channels, decoder)
    report(0.8, "writing parts")
    made = replace(made, warnings=(*made.warnings, *note))
    write(device, made, folder, layout, prediction)


def _relief(
    device: Device,
    folder: Path,
    surface: Surface,
    sensors: Sequence[Sensor],
    bay: Prism | None,
    decoder: str,
) -> tuple[Device, list[str]]:
    """The device with its strain relief decided where it leaves that open: bends are left out where
    the deeper pockets would cost too much accuracy, with a note."""
    f = device.fabrication
    if f.strain_relief is not None or not f.pockets:
        return device, []
    found = []
    for relief in (False, True):
        changed = replace(device, fabrication=replace(f, strain_relief=relief))
        r = rules(changed, bay)
        channels = channels_of(sensors, surface, r.channel, r.inner_wall, r.pockets)
        found.append((changed, as_made(device, folder, channels, decoder).rmse))
    (straight, without), (bent, with_bends) = found
    if with_bends <= _WORSE * without:
        return bent, []
    return straight, [
        "wires leave by the cords' mouths, without a bend that relieves their joints: the deeper"
        f" pockets would raise the predicted error from {without:.2f} to {with_bends:.2f} mm;"
        " strain_relief = true in [fabrication] makes them"
    ]


def fabricate(
    device: Device,
    surface: Surface,
    sensors: Sequence[Sensor],
    report: Report,
    solid: Any = None,
    bay: Prism | None = None,
) -> Made:
    """The device's parts. Raises FabricationError where a cord or a part fails a check."""
    problems = verify(sensors, surface, limits(device)).problems
    if problems:
        raise FabricationError(problems[0])
    return make_parts(surface, sensors, rules(device, bay), report, solid)


def as_made(device: Device, folder: Path, channels: Sequence[Channel], decoder: str) -> Prediction:
    """What the device is predicted to sense without the ends of cords that lie in pockets."""
    task = load_task(device, folder).decoded_by(decoder)
    paths = [_sensing(c) for c in channels]
    return predict(task.everything, paths, task.names, task.held)[0]


def _sensing(channel: Channel) -> Float:
    """The stretch of a cord's path (p, 3) mm outside of its pockets."""
    path = sample_path(channel.sensor)
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    hidden = [max(0.0, e.pocket - i) for e, i in zip(channel.ends, channel.inlets, strict=True)]
    at = np.linspace(hidden[0], along[-1] - hidden[1], len(path))
    return np.stack([np.interp(at, along, path[:, i]) for i in range(3)], axis=1)


def write(
    device: Device,
    made: Made,
    folder: Path,
    layout: Mapping[str, Any],
    prediction: Prediction | None = None,
) -> None:
    """Leave the parts in `folder`/parts; `layout` is what `layout.json` holds, `prediction` that
    for the cords as they are built in."""
    flat = {p.name: laid(p.surface, p.down) for p in made.parts}
    pins = _pins(made)
    names = [n for name, (_, count, _) in pins.items() for n in _copies(name, count)]
    loose = {n: pins[n.split("_")[0]][0] for n in names}
    placed = arrange({**flat, **loose}, device.fabrication.bed, device.fabrication.process)
    out = folder / "parts"
    out.mkdir()
    (out / LYING).mkdir()
    for part in made.parts:
        write_stl(part.surface, out / f"{part.name}.stl")
        write_stl(flat[part.name], out / LYING / f"{part.name}.stl")
    for name, (surface, _, _) in pins.items():
        write_stl(surface, out / LYING / f"{name}.stl")
    solids = {p.name: p.solid for p in made.parts if p.solid is not None}
    if solids:
        from ...geometry.kernels import occ

        for name, solid in solids.items():
            occ.write_step(solid, out / f"{name}.step", name)
        occ.write_assembly(solids, out / "assembly.step", device.name)
    write_3mf({p.name: p.surface for p in made.parts}, out / "assembly.3mf", device.name)
    plates = _write_plates(placed, out, device.name)
    write_json(
        out / "manifest.json", _manifest(device, folder, made, pins, plates, layout, prediction)
    )


def _pins(made: Made) -> dict[str, tuple[Surface, int, dict[str, float]]]:
    """Every kind of loose pin: its surface, how many are needed, its sizes."""
    kinds: dict[str, tuple[Surface, int, dict[str, float]]] = {}
    for pin in made.pins:
        name = f"pin-{pin.diameter:g}x{pin.length:.1f}"
        if name in kinds:
            surface, count, sizes = kinds[name]
            kinds[name] = (surface, count + 1, sizes)
        else:
            solid = triangle_kernel.union([triangle_kernel.solid_of(t) for t in pin.shape])
            sizes = {"diameter": pin.diameter, "length": pin.length}
            kinds[name] = (triangle_kernel.printable(solid, name), 1, sizes)
    return kinds


def _copies(name: str, count: int) -> list[str]:
    return [f"{name}_{k + 1}" for k in range(count)]


def _write_plates(placed: Mapping[str, PlacedPart], out: Path, title: str) -> list[dict[str, Any]]:
    plates = []
    count = 1 + max(p.plate for p in placed.values())
    for k in range(count):
        on = {n: p.surface for n, p in placed.items() if p.plate == k}
        file = "plate.3mf" if count == 1 else f"plate-{k + 1}.3mf"
        write_3mf(on, out / file, title, together=False)
        plates.append({"file": file, "parts": {n: s.bounds.tolist() for n, s in on.items()}})
    return plates


def _manifest(
    device: Device,
    folder: Path,
    made: Made,
    pins: Mapping[str, tuple[Surface, int, Mapping[str, float]]],
    plates: Sequence[Mapping[str, Any]],
    layout: Mapping[str, Any],
    prediction: Prediction | None,
) -> dict[str, Any]:
    warnings = list(made.warnings)
    if prediction and prediction.rmse > _WORSE * layout["prediction"]["rmse"]:
        bent = any(c.leads for c in made.channels)
        way = "strain_relief = false" if bent else "pockets = false"
        warnings.append(
            f"the ends of cords in pockets do not sense: the predicted error rises from"
            f" {layout['prediction']['rmse']:.2f} to {prediction.rmse:.2f} mm; {way} in"
            " [fabrication] makes them shorter"
        )
    for s in layout["sensors"]:
        if s["peak_strain"] > device.cord.max_strain:
            warnings.append(
                f"cord {s['name']} is stretched by {s['peak_strain']:.0%}, more than its"
                f" {device.cord.max_strain:.0%}"
            )
    signals = np.array(read_json(folder / "prediction.json")["signals"])
    cords = cut_list(device, made, signals)
    return {
        "schema": 2,
        "device": device.name,
        "unit": "mm",
        "parts": [_part(made, i) for i in range(len(made.parts))],
        "pins": [
            {"name": n, "stl": f"{LYING}/{n}.stl", "count": count, **sizes}
            for n, (_, count, sizes) in pins.items()
        ],
        "plates": plates,
        "cords": cords,
        "bill": bill(device, made, cords, {n: count for n, (_, count, _) in pins.items()}),
        "assembly": _assembly(made),
        "marker_seats": [
            {
                "marker": s.number,
                "center": s.center.tolist(),
                "x_axis": s.axes[:, 0].tolist(),
                "normal": s.axes[:, 2].tolist(),
                "tag": device.fabrication.marker_size,
            }
            for s in made.seats
        ],
        "checks": [vars(c) for c in made.checks],
        "prediction": prediction.to_json() if prediction else None,
        "removed_volume": made.cut_out,
        "body_volume": made.body_volume,
        "warnings": warnings,
    }


def _part(made: Made, i: int) -> dict[str, Any]:
    part = made.parts[i]
    out: dict[str, Any] = {
        "name": part.name,
        "number": i + 1,
        "stl": f"{part.name}.stl",
        "print": f"{LYING}/{part.name}.stl",
        "step": None,
        "volume": part.volume,
        "bbox": part.surface.bounds.tolist(),
        "sockets": [
            {"center": p.center.tolist(), "axis": p.axis.tolist(), "diameter": p.socket}
            for p in made.pins
            if i in (made.contacts[p.contact].lower, made.contacts[p.contact].upper)
        ],
    }
    if part.solid is not None:
        from ...geometry.kernels import occ

        out["step"], out["step_volume"] = f"{part.name}.step", occ.volume(part.solid)
    return out


def _assembly(made: Made) -> list[dict[str, Any]]:
    """The steps in which the device is closed: the cuts backwards."""
    steps = []
    for k in reversed(range(len(made.cuts))):
        cut = made.cuts[k]
        pins = [p for p in made.pins if made.contacts[p.contact].cut == k]
        steps.append(
            {
                "join": [[made.parts[i].name for i in side] for side in cut.sides],
                "cords": [made.channels[c].name for c in cut.cords if c not in cut.wires],
                "wires": [made.channels[c].name for c in cut.wires],
                "opens": cut.plane.normal.tolist(),
                "pins": [
                    {
                        "name": f"pin-{p.diameter:g}x{p.length:.1f}",
                        "center": p.center.tolist(),
                        "socket": p.socket,
                        "depth": p.depth,
                        "between": [
                            made.parts[made.contacts[p.contact].lower].name,
                            made.parts[made.contacts[p.contact].upper].name,
                        ],
                    }
                    for p in pins
                ],
            }
        )
    return steps
