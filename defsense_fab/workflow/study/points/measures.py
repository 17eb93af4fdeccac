"""What is recorded of a run: numbers and words from the folder of its build."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from ....store.body import load_body_record
from ....store.fields import load_index
from ....store.layout import LayoutRecord, load_layout
from ....store.manifest import load_manifest
from ....store.mesh import load_mesh_record

Value = float | int | str | None

#: What each stage adds, in words; all lengths mm, volumes mm^3, errors RMSE of the markers in mm.
MEANING: dict[str, dict[str, str]] = {
    "body": {"volume": "of the body, mm³"},
    "mesh": {"tets": "tetrahedra", "min_dihedral": "their least dihedral angle, degrees"},
    "simulate": {
        "states": "states that were solved",
        "pose_warnings": "what is to be said of them",
    },
    "optimize": {
        "error": "RMSE on unseen states with the read-out's noise, mm",
        "error_noise_free": "the same without noise, mm",
        "fitted_error": "RMSE on the states designed for, mm",
        "peak": "largest error of a marker on them, mm",
        "average_peak": "mean over them of the largest error, mm",
        "floor": "least that any affine map of so many cords could reach, mm",
        "band_low": "90 % of built devices lie above, mm",
        "band_high": "90 % of built devices lie below, mm",
        "decoder": "the decoder that was chosen",
        "cords": "how many cords",
        "cord_length": "of all cords' channels together, mm",
        "planes": "planes that the body is cut along",
        "parts": "parts that it is cut into",
        "warnings": "what is to be said of the cords",
    },
    "fabricate": {
        "plates": "plates to print",
        "removed_volume": "what channels and pockets take away, mm³",
        "failed_checks": "checks of the parts that do not hold",
    },
}


#: Those that are no numbers.
WORDS = ("decoder",)


def of_stage(until: str) -> list[str]:
    """Names of the measures that a run up to a stage has."""
    names: list[str] = []
    for stage, measures in MEANING.items():
        names += measures
        if stage == until:
            break
    return names


def meaning(measure: str) -> str:
    """What a measure is, with its unit."""
    return next(m[measure] for m in MEANING.values() if measure in m)


def measure(folder: Path, until: str) -> dict[str, Value]:
    """All measures of a build in its `folder`. Raises StorageError where a file is missing."""
    out: dict[str, Value] = {}
    for stage, read in _READERS.items():
        out.update(read(folder))
        if stage == until:
            break
    return out


def _body(folder: Path) -> Mapping[str, Value]:
    return {"volume": load_body_record(folder).volume}


def _mesh(folder: Path) -> Mapping[str, Value]:
    record = load_mesh_record(folder)
    return {"tets": record.tets, "min_dihedral": record.min_dihedral}


def _simulate(folder: Path) -> Mapping[str, Value]:
    index = load_index(folder)
    return {"states": len(index.states), "pose_warnings": len(index.warnings)}


def _optimize(folder: Path) -> Mapping[str, Value]:
    layout: LayoutRecord = load_layout(folder)
    p = layout.prediction
    chosen = next((w for w in layout.weighed if w.chosen), None)
    return {
        "error": p.unseen,
        "error_noise_free": p.unseen_noise_free,
        "fitted_error": p.rmse,
        "peak": p.peak,
        "average_peak": p.average_peak,
        "floor": p.floor,
        "band_low": layout.band.low,
        "band_high": layout.band.high,
        "decoder": p.decoder,
        "cords": len(layout.sensors),
        "cord_length": float(sum(c.length for c in layout.sensors)),
        "planes": chosen.planes if chosen else None,
        "parts": chosen.parts if chosen else None,
        "warnings": len(layout.warnings),
    }


def _fabricate(folder: Path) -> Mapping[str, Value]:
    manifest = load_manifest(folder)
    return {
        "parts": len(manifest.parts),
        "plates": len(manifest.plates),
        "removed_volume": manifest.removed_volume,
        "failed_checks": sum(not c.holds for c in manifest.checks),
    }


_READERS: dict[str, Callable[[Path], Mapping[str, Value]]] = {
    "body": _body,
    "mesh": _mesh,
    "simulate": _simulate,
    "optimize": _optimize,
    "fabricate": _fabricate,
}
