"""The stages of a build: each reads the folder it is given and leaves its files there."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from ...core.device import Device
from ...core.files import digest

#: Raised when a stage's results change for the same input, so that old ones are not reused.
CODE_VERSION = 15

Report = Callable[[float, str], None]


@dataclass(frozen=True)
class Stage:
    """`run(device, folder, report)` writes `outputs` (names in the folder); `inputs` are hashed."""

    name: str
    title: str
    outputs: tuple[str, ...]
    inputs: Callable[[Device], Any]
    run: Callable[[Device, Path, Report], None]


#: Files beside a script that it may read or import; notes and results beside it do not count.
_SOURCES = {".py", ".step", ".stp", ".brep", ".stl", ".obj", ".3mf", ".csv", ".dxf", ".svg"}


def _body_inputs(d: Device) -> Any:
    files = [d.body.path]
    if d.body.kind == "script":
        files += sorted(
            p
            for p in d.source.rglob("*")
            if p.is_file()
            and p.suffix.lower() in _SOURCES
            and not any(
                n in ("build", "__pycache__") or n[0] == "." for n in p.relative_to(d.source).parts
            )
        )
    return (
        d.body.kind,
        sorted(d.body.parameters.items()),
        d.body.scale,
        plain(d.body.bay),
        [(p.name, digest(p)) for p in files],
    )


def _mesh_inputs(d: Device) -> Any:
    """With `accuracy` the poses choose the mesh, so it depends on them too."""
    poses = plain((d.material, d.poses)) if d.mesh.accuracy else None
    return (d.mesh.edge_length, d.mesh.accuracy, _regions(d), poses)


def _cord_room(d: Device) -> Any:
    """What of the printing process bears on where cords may run."""
    return (d.fabrication.clearance, d.fabrication.wall, d.fabrication.lead)


def _regions(d: Device) -> Any:
    return sorted((k, type(s).__name__, plain(vars(s))) for k, s in d.regions.items())


def plain(value: Any) -> Any:
    """Arrays as lists, so that hashes see numbers."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, dict):
        return sorted((k, plain(v)) for k, v in value.items())
    if isinstance(value, tuple | list):
        return [plain(v) for v in value]
    if isinstance(value, frozenset):
        return sorted(value)
    return plain(vars(value)) if hasattr(value, "__dataclass_fields__") else value


def _runner(name: str) -> Callable[[Device, Path, Report], None]:
    """`run` of the module `stage_<name>`, imported when it is called: CAD and VTK are heavy."""

    def run(device: Device, folder: Path, report: Report) -> None:
        module = import_module(f"{__package__}.stage_{name}")
        module.run(device, folder, report)

    return run


STAGES = (
    Stage("body", "load the body", ("body",), _body_inputs, _runner("body")),
    Stage(
        "mesh",
        "make tetrahedra",
        ("mesh.vtu", "mesh.json"),
        _mesh_inputs,
        _runner("mesh"),
    ),
    Stage(
        "simulate",
        "simulate the poses",
        ("fields",),
        lambda d: plain((d.material, d.poses, d.states)),
        _runner("simulate"),
    ),
    Stage(
        "optimize",
        "optimise the cords",
        ("layout.json", "prediction.json"),
        lambda d: plain(
            (d.cord, _cord_room(d), d.outputs, d.sensors, d.propose, d.planes, d.decoder)
        ),
        _runner("optimize"),
    ),
    Stage(
        "fabricate",
        "make the parts",
        ("parts",),
        lambda d: plain((d.name, d.fabrication)),
        _runner("fabricate"),
    ),
    Stage(
        "report",
        "write report and guide",
        ("report.html", "guide.html", "guide.pdf"),
        lambda d: d.name,
        _runner("report"),
    ),
)


def keys(device: Device) -> dict[str, str]:
    """The hash of all that each stage's result depends on, upstream stages included."""
    out: dict[str, str] = {}
    key = digest(CODE_VERSION)
    for stage in STAGES:
        key = digest(key, stage.name, stage.inputs(device))
        out[stage.name] = key
    return out


def read_json(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))
