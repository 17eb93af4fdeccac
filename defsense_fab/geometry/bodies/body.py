"""A body from a script, a STEP file or a triangle mesh: one closed solid in mm."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...core.device.device import BodySpec
from ...core.errors import BodyError
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism
from .body_file import read_mesh_body, read_step_body
from .child_process import Failure, finished, loaded_meanwhile, refusal
from .connector_bay import recess
from .script_process import RESULT, SOLIDS, TASK, SourceFile, script_failure

#: Largest distance of a facet from the true surface of a CAD body, mm.
TESSELLATION = 0.05
#: Bodies smaller or larger than this are taken for ones in other units, mm.
SIZES = (1.0, 1e4)


@dataclass(frozen=True)
class Body:
    """`surface` bounds the body; `solid` is its OpenCascade TopoDS_Solid where it is CAD; `bay` is
    the recess for a connector that both have; `sources` are the files that it was made from."""

    surface: Surface
    volume: float
    solid: Any = None
    repairs: tuple[str, ...] = ()
    bay: Prism | None = None
    sources: tuple[SourceFile, ...] = ()


def load_body(spec: BodySpec) -> Body:
    """Load the body that `spec` names, with its bay. Raises BodyError where it is not one closed
    solid, lies far from the origin, or has no room for the bay."""
    body = _load(spec)
    if spec.bay is None:
        return body
    bay = recess(spec.bay, body.surface)
    if body.solid is None:
        rest = triangle_kernel.without(
            triangle_kernel.to_manifold(body.surface, str(spec.path)), [bay]
        )
        surface, solid, volume = triangle_kernel.to_surface(rest), None, float(rest.volume())
    else:
        from ..kernels import occ

        solid = occ.without(body.solid, [bay])
        surface, volume = occ.tessellate(solid, TESSELLATION), occ.volume(solid)
    return replace(body, surface=surface, volume=volume, solid=solid, bay=bay)


def _load(spec: BodySpec) -> Body:
    if spec.kind == "script":
        solids, sources = _run_script(spec)
        from .cad_solid import cad_solid

        made = cad_solid(
            solids, str(spec.path), SIZES, TESSELLATION, False, spec.fill_cavities
        )  # fmt: skip
        return Body(made.surface, made.volume, made.solid, made.repairs, sources=sources)
    sources = (SourceFile.now(spec.path),)
    if spec.kind == "mesh":
        read = read_mesh_body(spec.path, spec.scale, SIZES, spec.fill_cavities, spec.time_limit)
    else:
        read = read_step_body(spec.path, SIZES, TESSELLATION, spec.fill_cavities, spec.time_limit)
    return Body(read.surface, read.volume, read.solid, read.repaired, sources=sources)


def _run_script(spec: BodySpec) -> tuple[list[Any], tuple[SourceFile, ...]]:
    """The TopoDS_Solids of `body(**parameters)` of the script, and the files that it read; what it
    prints goes to standard error."""
    path = spec.path
    failure = Failure(
        BodyError,
        f"{path}: the script",
        "find the call that ends it",
        "simplify the script, or raise [body] time_limit in device.toml",
    )

    def give(folder: Path) -> None:
        task = {"script": str(path), "parameters": dict(spec.parameters)}
        (folder / TASK).write_text(json.dumps(task, default=_plain), encoding="utf-8")

    module = f"{__package__}.script_process"
    # Both processes need the CAD kernel: this one loads it meanwhile.
    with (
        loaded_meanwhile("occ") as brep,
        finished(module, give, RESULT, spec.time_limit, failure, relay=True) as folder,
    ):
        made = json.loads((folder / RESULT).read_text(encoding="utf-8"))
        if "refused" in made:
            raise refusal(made, f"{path}: {made['refused']}")
        if "type" in made:
            raise script_failure(made, spec.parameters)
        solids = brep().read_brep(folder / SOLIDS)
    sources = tuple(SourceFile(Path(name), content) for name, content in made["sources"])
    # A file that has gone since was the script's own, for the time being.
    return solids, tuple(s for s in sources if s.content is None or s.path.exists())


def _plain(value: Any) -> Any:
    """A number of NumPy for JSON. Raises BodyError for a parameter that JSON does not have."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise BodyError(
        f"device.toml: body.parameters: cannot hold {value!r}; use numbers, texts, lists or tables",
        code="unsupported-parameter",
    )
