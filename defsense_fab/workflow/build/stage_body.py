"""Stage 1: the body's surface, and its exact solid if it is CAD."""

from __future__ import annotations

from ...core.device.device import Device
from ...geometry.bodies.body import load_body
from ...geometry.bodies.script_process import SourceFile
from ...store.body import BodyRecord, save_body
from ...store.build import Build
from . import body_sources
from .stages import Report


def run(device: Device, build: Build, report: Report) -> None:
    """Load the body, and save its surface, its solid and the files it was made from."""
    before = body_sources.cad_files(device)
    body = load_body(device.body)
    # Files that the script itself rewrote are not sources.
    sources = [s for s in before if s == SourceFile.from_path(s.path)] + list(body.sources)
    folder = build.folder / "body"
    folder.mkdir()
    body_sources.save_sources(device, build.folder, sources)
    if body.solid is not None:
        from ...geometry.kernels import occ

        report(0.8, "saving the solid")
        occ.write_step(body.solid, folder / "body.step", device.name)
    build.body = BodyRecord(
        body.volume, body.solid is not None, tuple(body.repairs), body.surface.bounds, body.bay
    )
    build.surface = body.surface
    save_body(build.folder, build.body, build.surface)
    for line in body.repairs:
        report(0.9, f"repaired: {line}")
