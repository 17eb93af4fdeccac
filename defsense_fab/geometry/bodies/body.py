"""A body from a script, a STEP file or a triangle mesh: one closed solid in mm."""

from __future__ import annotations

import contextlib
import os
import sys
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.device import BodySpec
from ...core.errors import BodyError
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism
from .connector_bay import recess

#: Largest distance of a facet from the true surface of a CAD body, mm.
TESSELLATION = 0.05
#: Bodies smaller or larger than this are taken for ones in other units, mm.
SIZES = (1.0, 1e4)


@dataclass(frozen=True)
class Body:
    """`surface` bounds the body; `solid` is its OpenCascade TopoDS_Solid where it is CAD; `bay` is
    the recess for a connector that both have."""

    surface: Surface
    volume: float
    solid: Any = None
    repairs: tuple[str, ...] = ()
    bay: Prism | None = None


def load_body(spec: BodySpec) -> Body:
    """Load the body that `spec` names, with its bay. Raises BodyError where it is not one closed
    solid, or has no room for the bay."""
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
    return Body(surface, volume, solid, body.repairs, bay)


def _load(spec: BodySpec) -> Body:
    if spec.kind == "mesh":
        from .mesh_repair import read_mesh

        surface, repairs = read_mesh(spec.path, spec.scale, SIZES)
        return Body(surface, surface.volume, None, repairs)
    from ..kernels import occ

    if spec.kind == "step":
        solids = occ.read_step(spec.path)
    else:
        result = _run_script(spec.path, spec.parameters)
        try:
            solids = occ.solids_of(result)
        except BodyError as error:
            raise BodyError(f"{spec.path}: {error}") from None
    if len(solids) != 1:
        raise BodyError(
            f"{spec.path}: gives {len(solids)} solids, one is needed; fuse them or remove the rest"
        )
    size = occ.size(solids[0])
    if not SIZES[0] <= size <= SIZES[1]:
        raise BodyError(
            f"{spec.path}: the body is {size:.3g} mm across; lengths are in mm: check its units"
        )
    surface = occ.tessellate(solids[0], TESSELLATION)
    volume = occ.volume(solids[0])
    if volume <= 0:
        raise BodyError(f"{spec.path}: the solid's volume is {volume:.3g} mm^3; turn its faces")
    return Body(surface, volume, solids[0])


def _run_script(path: Path, parameters: Mapping[str, Any]) -> Any:
    """Call `body(**parameters)` of the script; what it prints goes to standard error."""
    space: dict[str, Any] = {"__name__": "__body__", "__file__": str(path)}
    here = os.getcwd()
    sys.path.insert(0, str(path.parent))
    try:
        with contextlib.redirect_stdout(sys.stderr):
            exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), space)
            if not callable(space.get("body")):
                raise BodyError(
                    f"{path}: defines no function body(...); add one that returns a solid"
                )
            result = space["body"](**parameters)
    except (BodyError, KeyboardInterrupt):
        raise
    except BaseException as error:  # scripts may raise anything, or call exit()
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        line = frames[-1].lineno if frames else getattr(error, "lineno", None)
        where = f"{path}:{line}" if line else str(path)
        text = " ".join(str(error).split()) or "no message"
        raise BodyError(
            f"{where}: the script raised {type(error).__name__}: {text}; mend the script or its"
            " parameters"
        ) from None
    finally:
        os.chdir(here)
        with contextlib.suppress(ValueError):  # the script may have removed it
            sys.path.remove(str(path.parent))
    if result is None:
        raise BodyError(f"{path}: body() returned None; return the solid")
    return result
