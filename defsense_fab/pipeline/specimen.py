"""Files of the bending specimen and its jigs, and the strains that they give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.catalogue import read_rows
from ..core.errors import FabricationError
from ..core.files import storage_errors, write_json
from ..core.mesh import Surface
from ..core.progress import Progress, silent

if TYPE_CHECKING:
    from ..geometry.specimen import Specimen

FILE = "specimen.json"
#: DefSense (CHI 2016): radii of the jigs' surfaces, mm.
RADII = (75.0, 87.5, 100.0, 112.0, 150.0, 175.0, 200.0, 225.0, 250.0)
_DEVIATION = 0.01  # mm, of facets from the solid


@dataclass(frozen=True)
class Written:
    """What `specimen.json` holds, and where the files are."""

    data: dict[str, Any]
    folder: Path


def write_specimen(
    folder: Path,
    *,
    length: float = 150.0,
    thickness: float = 15.0,
    width: float = 20.0,
    offset: float = 2.0,
    radii: Sequence[float] = RADII,
    cord: str = "rubber-2mm",
    process: str = "fdm-tpu",
    progress: Progress = silent,
) -> Written:
    """Write STL (as they lie on the bed) and STEP files of the specimen's halves, a jig for each
    radius and a flat one, and `specimen.json` with the strain of each cord on each of them. All mm.

    Raises FabricationError for parts that cannot be or that the process's bed does not hold.
    """
    from ..geometry.specimen import Specimen, halves, jig

    row, printer = _row("cords.csv", "cord", cord), _row("printers.csv", "process", process)
    clearance, wall = float(printer["clearance"]), float(printer["wall"])
    good = all(np.isfinite(r) and r > 0 for r in radii)
    if not radii or not good or len({f"{r:g}" for r in radii}) < len(radii):
        raise FabricationError("jigs: give different radii above zero, in mm")
    spec = Specimen(length, thickness, width, offset, float(row["diameter"]) + clearance, clearance)
    solids: dict[str, Any] = {}
    for n, radius in enumerate([None, *sorted(radii)]):
        name = "jig-flat" if radius is None else f"jig-{radius:g}"
        progress("jigs", n / (len(radii) + 1), name)
        solids[name] = jig(spec, radius)
    progress("jigs", 1.0, "done")
    solids = halves(spec) | solids
    bed = tuple(float(printer[f"bed_{a}"]) for a in "xyz")
    parts = {name: _as_printed(name, solid) for name, solid in solids.items()}
    for name, surface in parts.items():
        _check_bed(name, surface, bed, process)
    warnings = []
    skin = offset - spec.channel_diameter / 2
    if skin < wall:
        warnings.append(
            f"the outer channels leave a skin of {skin:.2f} mm, less than the wall of {wall:g} mm"
            f" for {process}; --offset {wall + spec.channel_diameter / 2:.1f} leaves one"
        )
    data = _describe(spec, sorted(radii), cord, process, parts, warnings)
    with storage_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        _write(folder, parts, solids)
        write_json(folder / FILE, data)
    return Written(data, folder)


def _row(file: str, what: str, name: str) -> dict[str, str]:
    rows = read_rows(file)
    if name not in rows:
        raise FabricationError(f"unknown {what} {name!r}; there are {', '.join(rows)}")
    return rows[name]


def _as_printed(name: str, solid: Any) -> Surface:
    """The part's facets as it lies on the bed: halves on their outer side, jigs on theirs."""
    from ..geometry import facets, occ

    surface = facets.printable(facets.to_manifold(occ.tessellate(solid, _DEVIATION), name), name)
    up = -1.0 if name == "specimen-right" else 1.0
    turn = np.array([[1, 0, 0], [0, 0, -up], [0, up, 0]])  # y, or -y, points up
    vertices = surface.vertices @ turn.T
    low, high = vertices.min(0), vertices.max(0)
    return Surface(vertices - np.append((low + high)[:2] / 2, low[2]), surface.faces)


def _check_bed(name: str, surface: Surface, bed: Sequence[float], process: str) -> None:
    x, y, z = np.ptp(surface.bounds, axis=0)
    if z > bed[2] or not ((x <= bed[0] and y <= bed[1]) or (y <= bed[0] and x <= bed[1])):
        raise FabricationError(
            f"{name} measures {x:.0f} x {y:.0f} x {z:.0f} mm and does not fit the bed of {process}"
            f" ({bed[0]:g} x {bed[1]:g} x {bed[2]:g} mm); give a shorter specimen, or other radii"
        )


def _describe(
    spec: Specimen,
    radii: Sequence[float],
    cord: str,
    process: str,
    parts: dict[str, Surface],
    warnings: list[str],
) -> dict[str, Any]:
    jigs: list[dict[str, Any]] = [
        {"name": "jig-flat", "radius": None, "neutral_radius": None, "strains": [0.0] * 3}
    ]
    for r in radii:
        strains = [spec.strain(r, z) for z in spec.heights]
        neutral = r + spec.thickness / 2
        jigs.append(
            {"name": f"jig-{r:g}", "radius": r, "neutral_radius": neutral, "strains": strains}
        )
    return {
        "schema": 1,
        "unit": "mm",
        "length": spec.length,
        "thickness": spec.thickness,
        "width": spec.width,
        "channel_diameter": spec.channel_diameter,
        "channels": dict(zip(("inner", "neutral", "outer"), spec.heights, strict=True)),
        "cord": cord,
        "process": process,
        "jigs": jigs,
        "parts": [
            {
                "name": n,
                "stl": f"{n}.stl",
                "step": f"{n}.step",
                "size": np.ptp(s.bounds, 0).tolist(),
            }
            for n, s in parts.items()
        ],
        "warnings": warnings,
    }


def _write(folder: Path, parts: dict[str, Surface], solids: dict[str, Any]) -> None:
    from ..geometry import occ
    from ..geometry.export import write_stl

    for name, surface in parts.items():
        write_stl(surface, folder / f"{name}.stl")
        occ.write_step(solids[name], folder / f"{name}.step", name)
