"""The stages of a build: each reads the folder it is given and leaves its files there."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from importlib import import_module, metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.device.device import Device, FabricationSpec, Sensor
from ...core.device.materials import Silicone, find_silicone
from ...core.machine.processes import one_blas_thread
from ...core.storage.files import digest
from ...geometry.bodies.meshing import mesh_lock
from . import body_sources

if TYPE_CHECKING:
    from ...mechanics.solver.load_stepping import Equilibrium

#: Raised when a stage's results change for the same input, so that old ones are not reused.
CODE_VERSION = 39

Report = Callable[[float, str], None]


@dataclass(frozen=True)
class Seen:
    """What the search for cords has come to: a layout and its expected RMSE (mm) on the states that
    it is designed for; whether it is `kept`, being the best of its search that keeps every limit,
    or only passed on the way; the folder that the build works in, with the poses' fields."""

    folder: Path
    sensors: tuple[Sensor, ...]
    rmse: float
    kept: bool


Watch = Callable[[Seen], None]
#: Takes what `mechanics.solver.batch.solve_all` takes, and gives the same.
Solve = Callable[..., list[list["Equilibrium"]]]


@dataclass(frozen=True)
class Stage:
    """`run(device, folder, report)` writes `outputs` (names in the folder), "simulate" with another
    `solve` and "optimize" with a `watch` where they are given; `inputs` are hashed, and so are the
    versions of `libraries` (distributions) that shape the result; `lighter` is what to do where the
    memory does not suffice."""

    name: str
    title: str
    outputs: tuple[str, ...]
    inputs: Callable[[Device], Any]
    run: Callable[..., None]
    libraries: tuple[str, ...]
    lighter: str


def _body_inputs(d: Device) -> Any:
    """What the script or file was called; `body_sources` has the contents."""
    return (
        d.body.kind,
        body_sources.name_of(d, d.body.path),
        sorted(d.body.parameters.items()),
        d.body.scale,
        plain(d.body.bay),
        *(["cavities filled"] if d.body.fill_cavities else []),
    )


def _mesh_inputs(d: Device) -> Any:
    """With `accuracy` the poses choose the mesh, so it depends on them too; `device.mesh` may have
    been there before, or is what the stage left. The time limit counts where it would better it."""
    poses = plain((d.material, d.poses)) if d.mesh.accuracy else None
    locked = mesh_lock.content(d.source)
    longer = ["longer"] if mesh_lock.outgrown(d.source, d.mesh.time_limit) else []
    return (d.mesh.edge_length, d.mesh.accuracy, _regions(d), poses, locked, *longer)


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


def _of_the_parts(f: FabricationSpec) -> FabricationSpec:
    """What cords depend on: not on plates; on moulds where parts are cast, as no layout is taken
    whose moulds lock."""
    alike = FabricationSpec(f.process, f.clearance, f.wall, f.lead, (0.0, 0.0, 0.0))
    only = ["bed", "layer", "hole", "spacing", "supports", "copies"]
    if f.kind != "cast":
        only += ["kind", "line", "mould_wall", "shrinkage"]
    return replace(f, **{name: getattr(alike, name) for name in only})


def _silicone(d: Device) -> Silicone | None:
    """What the parts are cast of, as far as the table has it."""
    return find_silicone(d.material.name) if d.fabrication.kind == "cast" else None


def _search(d: Device) -> tuple[Any, ...]:
    """What is stated of the search for cords; nothing where nothing is."""
    usual = d.seed == Device.seed and d.searches is None
    return () if usual else (d.seed, d.searches)


def _runner(name: str) -> Callable[..., None]:
    """`run` of the module `stage_<name>`, imported when it is called: CAD and VTK are heavy."""

    def run(device: Device, folder: Path, report: Report, **more: Any) -> None:
        module = import_module(f"{__package__}.stage_{name}")
        # The solver of the poses gives the same with any number of threads, and gains from them.
        with nullcontext() if name == "simulate" else one_blas_thread():
            module.run(device, folder, report, **more)

    return run


_COARSER = "use a larger [mesh] edge_length in device.toml"

STAGES = (
    Stage(
        "body",
        "load the body",
        ("body",),
        _body_inputs,
        _runner("body"),
        ("build123d", "cadquery", "cadquery-ocp", "manifold3d", "trimesh", "lib3mf"),
        "simplify the body",
    ),
    Stage(
        "mesh",
        "make tetrahedra",
        ("mesh.vtu", "mesh.json"),
        _mesh_inputs,
        _runner("mesh"),
        ("netgen-mesher", "pytetwild", "libigl"),
        _COARSER,
    ),
    Stage(
        "simulate",
        "simulate the poses",
        ("fields",),
        lambda d: plain((d.material, d.poses, d.states)),
        _runner("simulate"),
        ("numpy", "scipy", "numba", "pypardiso", "mkl", "rslab"),
        _COARSER,
    ),
    Stage(
        "optimize",
        "optimise the cords",
        ("layout.json", "prediction.json", "layouts.json"),
        lambda d: plain(
            (
                d.cord,
                d.outputs,
                d.sensors,
                d.propose,
                d.planes,
                d.decoder,
                d.prefer,
                d.converter,
                _of_the_parts(d.fabrication),
                cast.shrinkage if (cast := _silicone(d)) else None,
                *_search(d),
            )
        ),
        _runner("optimize"),
        ("daqp", "libigl"),  # NumPy, SciPy and numba, too, by the key of the stage before
        _COARSER,
    ),
    Stage(
        "fabricate",
        "make the parts",
        ("parts",),
        lambda d: plain((d.name, d.fabrication, _silicone(d))),
        _runner("fabricate"),
        (),  # CAD and mesh kernels are those of the body
        "simplify the body, or use fewer cords",
    ),
    Stage(
        "report",
        "write report and guide",
        ("report.html", "guide.html", "guide.json", "guide.pdf"),
        lambda d: d.name,
        _runner("report"),
        ("pyvista", "vtk", "matplotlib", "jinja2", "reportlab"),
        "close other programs",
    ),
)


Versions = dict[str, list[tuple[str, str | None]]]


def keys(device: Device, folder: Path, versions: Versions | None = None) -> dict[str, str]:
    """The hash of all that each stage's result depends on, upstream stages included, for the body
    in `folder`: of the files that it was made from it has the contents that they had then. With
    `versions`, what `installed` gave is not asked for again."""
    versions = versions or installed()
    out: dict[str, str] = {}
    key = digest(CODE_VERSION, body_sources.recorded(folder))
    for stage in STAGES:
        key = digest(key, stage.name, stage.inputs(device), versions[stage.name])
        out[stage.name] = key
    return out


def installed() -> Versions:
    """By stage the versions of its libraries, None where one is not there: known without importing
    it."""
    return {s.name: [(name, _version(name)) for name in s.libraries] for s in STAGES}


def _version(library: str) -> str | None:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return None


def read_json(path: Path) -> Any:
    """What is in a file of the build."""
    return json.loads(path.read_text(encoding="utf-8"))
