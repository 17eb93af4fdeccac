"""Load a device's body from a script, a STEP file or a triangle mesh: one closed solid in mm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from ...core.device.device import BodySpec
from ...core.mesh import Surface
from ..kernels import triangle_kernel
from ..kernels.cutting_tools import Prism
from .body_file import read_mesh_body, read_step_body
from .connector_bay import place_bay
from .script_process import SourceFile, run_script

#: Largest distance of a facet from the true surface of a CAD body, mm.
TESSELLATION_MM = 0.05
#: Smallest and largest plausible body, mm: others are probably in another unit.
SIZE_RANGE_MM = (1.0, 1e4)


@dataclass(frozen=True)
class Body:
    """A device's body.

    Attributes:
        surface: Closed triangle surface, mm.
        volume: Enclosed volume, mm^3 (exact for CAD bodies).
        solid: OpenCascade TopoDS_Solid of a CAD body, else None.
        repairs: Sentences on what was repaired.
        bay: Recess for the connector that surface and solid both have, or None.
        sources: Files that the body was made from.
    """

    surface: Surface
    volume: float
    solid: Any = None
    repairs: tuple[str, ...] = ()
    bay: Prism | None = None
    sources: tuple[SourceFile, ...] = ()


def load_body(spec: BodySpec) -> Body:
    """Load the body that `spec` describes and cut its connector bay.

    Args:
        spec: The `[body]` section of a device.

    Returns:
        The body in the device's rest frame.

    Raises:
        BodyError: If the body is not one closed solid, lies far from the origin, or has no room
            for the bay.
    """
    body = _load(spec)
    if spec.bay is None:
        return body
    bay = place_bay(spec.bay, body.surface)
    if body.solid is None:
        rest = triangle_kernel.cut_out(
            triangle_kernel.to_manifold(body.surface, str(spec.path)), [bay]
        )
        surface, solid, volume = triangle_kernel.to_surface(rest), None, float(rest.volume())
    else:
        from ..kernels import occ

        solid = occ.cut_out(body.solid, [bay])
        surface, volume = occ.tessellate(solid, TESSELLATION_MM), occ.volume(solid)
    return replace(body, surface=surface, volume=volume, solid=solid, bay=bay)


def _load(spec: BodySpec) -> Body:
    """Load the body without its bay."""
    if spec.kind == "script":
        solids, sources = run_script(spec)
        from .cad_solid import make_cad_solid

        cad = make_cad_solid(
            solids,
            str(spec.path),
            SIZE_RANGE_MM,
            TESSELLATION_MM,
            is_relative=False,
            fill_cavities=spec.fill_cavities,
        )
        return Body(cad.surface, cad.volume, cad.solid, cad.repairs, sources=sources)
    sources = (SourceFile.from_path(spec.path),)
    if spec.kind == "mesh":
        body = read_mesh_body(
            spec.path, spec.scale, SIZE_RANGE_MM, spec.fill_cavities, spec.time_limit
        )
    else:
        body = read_step_body(
            spec.path, SIZE_RANGE_MM, TESSELLATION_MM, spec.fill_cavities, spec.time_limit
        )
    return Body(body.surface, body.volume, body.solid, body.repairs, sources=sources)
