"""What a print with traces must contain, for the check of its G-code: the file `traces.json`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.device.filaments import TraceSpec
from ...core.errors import FabricationError
from ...core.storage.files import load_json, write_json
from ...geometry.printing.conductor_network import Resistivity
from ...geometry.printing.traces import Trace

DESIGN_FILE = "traces.json"
SCHEMA = 1
_WRITE_AGAIN = "Write the calibration parts again"


@dataclass(frozen=True)
class PrintDesign:
    """Traces of a print as they were designed, in the frame of the files for slicers.

    Attributes:
        name: Name of the object, for errors.
        traces: The traces.
        volume: Volume of all traces and pads, mm^3.
        expected: Resistance (t,) of each trace, ohm.
        bounds: Lowest and highest corner (2, 3) of the object, mm.
        resistivity: Resistivity of the conductive filament.
        pads: Middles (n, 3) of all pads on the skin, mm.
        pad_reach: Largest distance of a pad's filament from its middle, mm.
    """

    name: str
    traces: tuple[Trace, ...]
    volume: float
    expected: tuple[float, ...]
    bounds: Float
    resistivity: Resistivity
    pads: Float
    pad_reach: float


def resistivity_of(spec: TraceSpec) -> Resistivity:
    """Return the resistivity of a filament by direction."""
    along = spec.resistivity
    return Resistivity(along, spec.across * along, spec.between_layers * along)


def write_design(design: PrintDesign, folder: Path) -> None:
    """Write `traces.json` into a folder.

    Raises:
        StorageError: The file cannot be written.
    """
    rho = design.resistivity
    traces = [
        {
            "name": trace.name,
            "width": trace.width,
            "height": trace.height,
            "line": _round(trace.points),
            "resistance": round(expected, 2),
        }
        for trace, expected in zip(design.traces, design.expected, strict=True)
    ]
    data = {
        "schema": SCHEMA,
        "unit": "mm",
        "name": design.name,
        "bounds": _round(design.bounds),
        "volume": round(design.volume, 3),
        "pads": _round(design.pads),
        "pad_reach": round(design.pad_reach, 4),
        "resistivity": {"along": rho.along, "across": rho.across, "layers": rho.layers},
        "traces": traces,
    }
    write_json(folder / DESIGN_FILE, data)


def read_design(folder: Path) -> PrintDesign:
    """Read the `traces.json` of a folder.

    Raises:
        FabricationError: The file cannot be read or is invalid.
    """
    path = folder / DESIGN_FILE
    data = load_json(path, FabricationError, _WRITE_AGAIN)
    try:
        if data["schema"] != SCHEMA:
            raise ValueError(f"schema {data['schema']}")
        traces = tuple(
            Trace(str(t["name"]), _points(t["line"]), float(t["width"]), float(t["height"]))
            for t in data["traces"]
        )
        bounds = _points(data["bounds"])
        if not traces or bounds.shape != (2, 3):
            raise ValueError("no traces, or bounds that are not two points")
        return PrintDesign(
            str(data["name"]),
            traces,
            float(data["volume"]),
            tuple(float(t["resistance"]) for t in data["traces"]),
            bounds,
            Resistivity(**{k: float(v) for k, v in data["resistivity"].items()}),
            _points(data["pads"]),
            float(data["pad_reach"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FabricationError(
            f"does not describe printed traces ({error!r})",
            code="design-file-invalid",
            where=path,
            action=_WRITE_AGAIN,
        ) from None


def _points(rows: Sequence[Sequence[float]]) -> Float:
    return np.array(rows, float)


def _round(points: Float) -> list[list[float]]:
    rounded: list[list[float]] = (np.round(points, 4) + 0.0).tolist()
    return rounded
