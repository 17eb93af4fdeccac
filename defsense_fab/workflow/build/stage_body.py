"""Stage 1: the body's surface, and its exact solid where it is CAD."""

from __future__ import annotations

from pathlib import Path

from ...core.device.device import Device
from ...geometry.bodies.body import load_body
from ...geometry.bodies.body_record import BodyRecord, save_body
from ...geometry.bodies.script_process import SourceFile
from . import body_sources
from .stages import Report


def run(device: Device, folder: Path, report: Report) -> None:
    """Load the body, and save its surface, its solid and what it was made from."""
    lying = body_sources.cad_files(device)
    body = load_body(device.body)
    # Those that the script wrote anew itself are no sources.
    sources = [s for s in lying if s == SourceFile.now(s.path)] + list(body.sources)
    out = folder / "body"
    out.mkdir()
    body_sources.record(device, folder, sources)
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
