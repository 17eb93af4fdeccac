"""The stages of a build, and the keys that say which results are up to date."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib import import_module, metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...core.device.device import Device, FabricationSpec, Sensor
from ...core.device.material_table import unusual_properties
from ...core.device.materials import Silicone, find_silicone
from ...core.device.regions import Shape
from ...core.errors import CapacityError
from ...core.machine.processes import one_blas_thread
from ...core.progress import Progress
from ...core.progress import Report as Report
from ...core.storage.files import digest
from ...geometry.bodies.meshing import mesh_store
from ...sensing.memory_residual import AFFINE, TRAINED, known_family, memory_residuals
from ...store.fields import TRACED
from ...store.forces import FORCES
from ...store.layout import LAYOUT
from . import body_sources

if TYPE_CHECKING:
    from ...store.build import Build

#: Raised when a stage's results change for the same input, so that old results are not reused.
CODE_VERSION = 60
#: The stage that places copies on plates, the only one that depends on `BuildOptions`.
PLATES = "fabricate"


@dataclass(frozen=True)
class SearchProgress:
    """A layout that the search for cords has reached.

    Attributes:
        folder: Folder that the build works in, with the fields of the poses.
        sensors: The cords.
        rmse: Expected RMSE on the states that the layout is designed for, mm.
        kept: Whether this is the best layout of its search that violates no limit; otherwise it is
            an intermediate step.
    """

    folder: Path
    sensors: tuple[Sensor, ...]
    rmse: float
    kept: bool


Watch = Callable[[SearchProgress], None]


@dataclass(frozen=True)
class Stage:
    """A stage of a build.

    Attributes:
        name: Name, as in `defsense build --until`.
        title: What the stage does, for messages: an imperative phrase.
        outputs: Names of the files and folders that the stage leaves in the build's folder.
        inputs: Returns what the result depends on besides the earlier stages; it is hashed.
        libraries: Distributions whose versions affect the result.
        lighter: What to do if the memory is insufficient.
    """

    name: str
    title: str
    outputs: tuple[str, ...]
    inputs: Callable[[Device], Any]
    libraries: tuple[str, ...]
    lighter: str

    def run(self, device: Device, build: Build, progress: Progress, **extra: Any) -> Any:
        """Compute the results, put them into `build` and write its files.

        Args:
            device: The device.
            build: Results of the earlier stages, in the folder that this build works in.
            progress: Receives the stage's name, the completed fraction and a message.
            extra: Further arguments of the stage's `run`: `solve` of "simulate", `watch` and
                `earlier` of "optimize", `winner` of "fabricate".

        Returns:
            What the stage's `run` returns: of "optimize" the parts of the chosen layout.

        Raises:
            DefsenseError: The stage failed; CapacityError if the memory is insufficient.
        """
        # Imported here, as CAD and VTK are heavy.
        module = import_module(f"{__package__}.stage_{self.name}")
        # The solver of the poses gives the same with any number of threads, and gains from them.
        threads = nullcontext() if self.name == "simulate" else one_blas_thread()
        try:
            with threads:
                return module.run(device, build, partial(progress, self.name), **extra)
        except MemoryError:
            raise CapacityError(
                f"the memory is insufficient to {self.title}",
                code="memory-insufficient",
                where=device.source,
                action=self.lighter,
                stage=self.name,
            ) from None


def _body_inputs(d: Device) -> Any:
    """How the script or file is called; `body_sources` has the contents."""
    return (
        d.body.kind,
        body_sources.relative_name(d, d.body.path),
        sorted(d.body.parameters.items()),
        d.body.scale,
        plain(d.body.bay),
        *(["cavities filled"] if d.body.fill_cavities else []),
    )


def _mesh_inputs(d: Device) -> Any:
    """With `accuracy` the mesh also depends on the poses.

    `device.mesh` may have existed before the stage, or have been left by it. The time limit counts
    only where a longer one would give a better mesh.
    """
    poses = plain((d.simulated_material, d.poses)) if d.mesh.accuracy else None
    locked = mesh_store.file_digest(d.source)
    longer = ["longer"] if mesh_store.has_outgrown_mesh(d.source, d.mesh.time_limit) else []
    return (d.mesh.edge_length, d.mesh.accuracy, _regions(d), poses, locked, *longer)


def _regions(d: Device) -> Any:
    return sorted((k, *_shape(s)) for k, s in d.regions.items())


def _named_shapes(d: Device, names: Sequence[str]) -> list[Any]:
    return [[(name, *_shape(d.regions[name])) for name in sorted(names)]] if names else []


def _shape(shape: Shape) -> tuple[str, Any]:
    return type(shape).__name__, plain(vars(shape))


def plain(value: Any) -> Any:
    """Return a value as lists, numbers and texts, so that it can be hashed."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, dict):
        return sorted((k, plain(v)) for k, v in value.items())
    if isinstance(value, tuple | list):
        return [plain(v) for v in value]
    if isinstance(value, frozenset):
        return sorted(value)
    return plain(vars(value)) if hasattr(value, "__dataclass_fields__") else value


def _simulation_inputs(d: Device) -> Any:
    doubts = unusual_properties(d.material)
    return plain((d.simulated_material, doubts, d.poses, d.states))


def _layout_inputs(f: FabricationSpec) -> FabricationSpec:
    """Return what the cords depend on, other fields at a constant.

    Cords do not depend on plates. They depend on moulds where parts are cast, as no layout is
    chosen whose moulds cannot be opened.
    """
    constant = FabricationSpec(f.process, f.clearance, f.wall, f.lead, (0.0, 0.0, 0.0))
    ignored = ["bed", "layer", "hole", "spacing", "copies", "rate"]
    if f.kind != "cast":
        ignored += ["kind", "line", "mould_wall", "shrinkage"]
    return replace(f, **{name: getattr(constant, name) for name in ignored})


def _silicone(d: Device) -> Silicone | None:
    """Return the silicone that parts are cast from, if the table has it."""
    return find_silicone(d.material.name) if d.fabrication.kind == "cast" else None


def layout_parts(d: Device) -> tuple[Any, Any]:
    """Return what a layout depends on besides mesh, states and drawn cords, in plain values.

    Returns:
        What it is designed for, and the fabrication with the material, which set its limits.
    """
    silicone = _silicone(d)
    has_default_search = d.seed == Device.seed and d.searches is None
    design = (
        d.cord,
        d.outputs,
        d.propose,
        d.planes,
        d.decoder,
        d.prefer,
        d.converter,
        [memory_residuals(d.cord.name, k, n) for k in (TRAINED, AFFINE) for n in (1, 2)],
        known_family(d.cord.name),
        *(() if has_default_search else (d.seed, d.searches)),
        *_named_shapes(d, d.exits),
        *_named_shapes(d, d.fabrication.keep_whole),
    )
    shrinkage = None if silicone is None else silicone.shrinkage
    return plain(design), plain((_layout_inputs(d.fabrication), d.material, shrinkage))


_COARSER = "use a larger [mesh] edge_length in device.toml"

STAGES = (
    Stage(
        "body",
        "load the body",
        ("body",),
        _body_inputs,
        ("build123d", "cadquery", "cadquery-ocp", "manifold3d", "trimesh", "lib3mf"),
        "simplify the body",
    ),
    Stage(
        "mesh",
        "make tetrahedra",
        ("mesh.vtu", "mesh.json"),
        _mesh_inputs,
        ("netgen-mesher", "pytetwild", "libigl"),
        _COARSER,
    ),
    Stage(
        "simulate",
        "simulate the poses",
        ("fields",),
        _simulation_inputs,
        ("numpy", "scipy", "pypardiso", "mkl", "rslab"),
        _COARSER,
    ),
    Stage(
        "optimize",
        "optimize the layout",
        ("layout.json", "prediction.json", "layouts.json", FORCES, TRACED),
        lambda d: (*layout_parts(d), plain(d.sensors), d.parts),
        ("daqp", "libigl"),  # NumPy and SciPy count by the key of the stage before
        _COARSER,
    ),
    Stage(
        PLATES,
        "make the parts",
        ("parts",),
        lambda d: plain((d.name, d.fabrication, _silicone(d))),
        (),  # CAD and mesh kernels are those of the body
        "simplify the body, or use fewer sensors",
    ),
    Stage(
        "report",
        "write the report and the guide",
        ("report.html", "guide.html", "guide.json", "templates.pdf", "wiring.svg", "wireviz.yml"),
        lambda d: plain((d.name, d.board, d.prices)),
        ("pyvista", "vtk", "matplotlib", "jinja2", "reportlab"),
        "close other programs",
    ),
)
#: Names of the stages that need no cords.
STAGES_WITHOUT_CORDS = ("body", "mesh", "simulate")


Versions = Mapping[str, list[tuple[str, str | None]]]


class StageKeys:
    """The keys of a device's stages; each set is computed once per content of the body's sources.

    A key is a hash of all that a stage's result depends on, earlier stages included.

    Args:
        device: The device.
        versions: What `installed_versions` returned; None: the installed versions.
    """

    def __init__(self, device: Device, versions: Versions | None = None) -> None:
        self._device = device
        self._versions = versions or installed_versions()
        self._cache: dict[str, dict[str, str]] = {}

    def of(self, folder: Path) -> dict[str, str]:
        """Return the key of each stage for the body in a build's folder.

        The body counts with the contents that its sources had when it was made.
        """
        sources = body_sources.load_sources(folder)
        # `device.mesh` may be written by the stage of the mesh.
        locked = mesh_store.file_digest(self._device.source)
        # Layouts of the same input differ if one continues from an earlier layout.
        path = folder / LAYOUT
        layout = digest(path) if path.exists() else None
        cached = json.dumps([sources, locked, layout])
        if cached not in self._cache:
            self._cache[cached] = self._compute(sources, layout)
        return self._cache[cached]

    def _compute(self, sources: body_sources.Sources | None, layout: str | None) -> dict[str, str]:
        keys: dict[str, str] = {}
        key = digest(CODE_VERSION, sources)
        for stage in STAGES:
            after = (layout,) if stage.name == PLATES else ()
            inputs = stage.inputs(self._device)
            key = digest(key, stage.name, inputs, self._versions[stage.name], *after)
            keys[stage.name] = key
        return keys


def stage_keys(device: Device, folder: Path, versions: Versions | None = None) -> dict[str, str]:
    """Return the key of each stage for the body in a build's folder; see `StageKeys`."""
    return StageKeys(device, versions).of(folder)


@cache
def installed_versions() -> Versions:
    """Return the installed version of each stage's libraries, without importing them.

    They are found once per process.

    Returns:
        By stage, the distributions with their versions; None for those that are not installed.
    """
    return {s.name: [(name, _version(name)) for name in s.libraries] for s in STAGES}


def _version(library: str) -> str | None:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return None
