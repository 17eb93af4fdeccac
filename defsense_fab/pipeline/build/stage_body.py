"""Stage 1: the body's surface, and its exact solid where it is CAD."""

from __future__ import annotations

from pathlib import Path

from ...core.device import Device
from ...geometry.bodies.body import load_body
from ..artifacts.body import BodyRecord, save_body
from .stages import Report


def run(device: Device, folder: Path, report: Report) -> None:
    body = load_body(device.body)
    out = folder / "body"
    out.mkdir()
    if body.solid is not None:
        from ...geometry.kernels import occ

        report(0.8, "saving the solid")
        occ.write_step(body.solid, out / "body.step", device.name)
    record = BodyRecord(
        body.volume, body.solid is not None, tuple(body.repairs), body.surface.bounds, body.bay
    )
    save_body(folder, record, body.surface)
    for line in body.repairs:
        report(0.9, f"repaired: {line}")
