"""Measures of a run: numbers and words from the folder of its build."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from ....store.body import load_body_record
from ....store.fields import load_index
from ....store.layout import LayoutRecord, load_layout
from ....store.manifest import load_manifest
from ....store.mesh import load_mesh_record

Value = float | int | str | None

#: Measures of each stage and their meaning; errors are RMSE of the markers.
MEANING: dict[str, dict[str, str]] = {
    "body": {"volume": "volume of the body, mm³"},
    "mesh": {"tets": "number of tetrahedra", "min_dihedral": "smallest dihedral angle, degrees"},
    "simulate": {
        "states": "number of solved states",
        "pose_warnings": "number of warnings about poses",
    },
    "optimize": {
        "error": "RMSE in unseen states with the noise of the read-out, mm",
        "error_noise_free": "the same without noise, mm",
        "fitted_error": "RMSE in the states of the design, mm",
        "peak": "largest error of a marker in them, mm",
        "average_peak": "mean of the largest error over them, mm",
        "floor": "smallest RMSE of an affine map of as many signals, mm",
        "band_low": "90 % of built devices are above, mm",
        "band_high": "90 % of built devices are below, mm",
        "decoder": "chosen decoder",
        "cords": "number of cords",
        "cord_length": "length of all channels, mm",
        "planes": "number of cutting planes",
        "parts": "number of parts",
        "warnings": "number of warnings about cords",
    },
    "fabricate": {
        "plates": "number of plates to print",
        "removed_volume": "volume of channels and pockets, mm³",
        "failed_checks": "number of failed checks of the parts",
    },
}


#: Measures that are words.
WORDS = ("decoder",)


def measures_until(until: str) -> list[str]:
    """Return the names of the measures of a run up to a stage."""
    names: list[str] = []
    for stage, measures in MEANING.items():
        names += measures
        if stage == until:
            break
    return names


def describe_measure(measure: str) -> str:
    """Return the meaning of a measure with its unit."""
    return next(m[measure] for m in MEANING.values() if measure in m)


def measure(folder: Path, until: str) -> dict[str, Value]:
    """Measure a build.

    Args:
        folder: Folder of the build.
        until: Its last stage.

    Raises:
        StorageError: A file is missing.
    """
    measures: dict[str, Value] = {}
    for stage, read in _READERS.items():
        measures.update(read(folder))
        if stage == until:
            break
    return measures


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
