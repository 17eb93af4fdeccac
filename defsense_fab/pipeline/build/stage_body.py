"""Stage 1: the body's surface, and its exact solid where it is CAD."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...core.device import Device
from ...core.files import write_json
from ...core.mesh import Surface
from ...geometry.bodies.body import load_body
from ...geometry.kernels.cutting_tools import Prism
from .stages import Report, plain, read_json


def run(device: Device, folder: Path, report: Report) -> None:
    body = load_body(device.body)
    out = folder / "body"
    out.mkdir()
    np.savez(out / "surface.npz", vertices=body.surface.vertices, faces=body.surface.faces)
    if body.solid is not None:
        from ...geometry.kernels import occ

        report(0.8, "saving the solid")
        occ.write_step(body.solid, out / "body.step", device.name)
    write_json(
        out / "body.json",
        {
            "volume": body.volume,
            "cad": body.solid is not None,
            "repairs": list(body.repairs),
            "bounds": body.surface.bounds.tolist(),
            "bay": dict(plain(vars(body.bay))) if body.bay else None,
        },
    )
    for line in body.repairs:
        report(0.9, f"repaired: {line}")


def load_surface(folder: Path) -> Surface:
    with np.load(folder / "body" / "surface.npz") as data:
        return Surface(data["vertices"], data["faces"])


def is_cad(folder: Path) -> bool:
    return bool(read_json(folder / "body" / "body.json")["cad"])


def load_bay(folder: Path) -> Prism | None:
    """The connector bay that the body has, if any."""
    bay = read_json(folder / "body" / "body.json")["bay"]
    if bay is None:
        return None
    origin, axes, polygon = (np.array(bay[k]) for k in ("origin", "axes", "polygon"))
    return Prism(origin, axes, polygon, bay["height"])
