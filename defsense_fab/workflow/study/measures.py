"""Measures of a run: numbers and words from the results of its build."""

from __future__ import annotations

from collections.abc import Callable, Sized
from operator import attrgetter

from ...store.build import Build

Value = float | int | str | None


def _chosen(name: str) -> Callable[[Build], Value]:
    """Return a reader of the chosen layout's trial; None without a comparison of layouts."""
    return lambda build: next(
        (getattr(trial, name) for trial in build.layout.weighed if trial.chosen), None
    )


#: Measures that are words.
WORDS = ("decoder",)
#: Measures of each stage: their meaning, and the attribute of a build (or how many items it has).
#: Errors are RMSE of the markers.
_MEASURES: dict[str, dict[str, tuple[str, str | Callable[[Build], Value]]]] = {
    "body": {"volume": ("volume of the body, mm³", "body.volume")},
    "mesh": {
        "tets": ("number of tetrahedra", "mesh_record.tets"),
        "min_dihedral": ("smallest dihedral angle, degrees", "mesh_record.min_dihedral"),
    },
    "simulate": {
        "states": ("number of solved states", "field_index.states"),
        "pose_warnings": ("number of warnings about poses", "field_index.warnings"),
    },
    "optimize": {
        "error": (
            "RMSE in unseen states with the noise of the read-out, mm",
            "layout.prediction.unseen",
        ),
        "error_noise_free": (
            "RMSE in unseen states without noise, mm",
            "layout.prediction.unseen_noise_free",
        ),
        "fitted_error": ("RMSE in the states of the design, mm", "layout.prediction.rmse"),
        "peak": (
            "largest error of a marker in the states of the design, mm",
            "layout.prediction.peak",
        ),
        "average_peak": (
            "mean of the largest error over the states of the design, mm",
            "layout.prediction.average_peak",
        ),
        "floor": (
            "smallest RMSE of an affine map of as many signals, mm",
            "layout.prediction.floor",
        ),
        "trained": ("RMSE expected after training, mm", "layout.band.trained.median"),
        "trained_low": ("lower limit of 90 % of trained devices, mm", "layout.band.trained.low"),
        "trained_high": ("upper limit of 90 % of trained devices, mm", "layout.band.trained.high"),
        "band_low": ("lower limit of 90 % by noise and tolerances, mm", "layout.band.low"),
        "band_high": ("upper limit of 90 % by noise and tolerances, mm", "layout.band.high"),
        "force": ("largest force along the movement of a pose, N", "forces.largest"),
        "torque": ("largest moment that holds a region in a pose, N mm", "forces.largest_torque"),
        "trace_work": ("factor of work that printed traces add to a pose", "forces.traces"),
        "decoder": ("chosen decoder", "layout.prediction.decoder"),
        "cords": ("number of cords or traces", "layout.sensors"),
        "cord_length": (
            "length of all channels, mm",
            lambda build: float(sum(cord.length for cord in build.layout.sensors)),
        ),
        "planes": ("number of cutting planes", _chosen("planes")),
        "parts": ("number of parts", _chosen("parts")),
        "warnings": ("number of warnings about cords", "layout.warnings"),
    },
    "fabricate": {
        "parts": ("number of parts", "manifest.parts"),
        "plates": ("number of plates to print", "manifest.plates"),
        "r0_low": (
            "smallest resistance at rest, ohm",
            lambda build: min((c.resistance for c in build.manifest.cords), default=None),
        ),
        "r0_high": (
            "largest resistance at rest, ohm",
            lambda build: max((c.resistance for c in build.manifest.cords), default=None),
        ),
        "removed_volume": ("volume of channels and pockets, mm³", "manifest.removed_volume"),
        "failed_checks": (
            "number of failed checks of the parts",
            lambda build: sum(not check.holds for check in build.manifest.checks),
        ),
    },
}
#: Stages that a run may go to.
MEASURED_STAGES = tuple(_MEASURES)


def measures_until(stage: str) -> list[str]:
    """Return the names of the measures of a run up to a stage."""
    stages = MEASURED_STAGES[: MEASURED_STAGES.index(stage) + 1]
    return list(dict.fromkeys(name for s in stages for name in _MEASURES[s]))


def describe_measure(measure: str) -> str:
    """Return the meaning of a measure with its unit."""
    return next(names[measure][0] for names in _MEASURES.values() if measure in names)


def measure(build: Build, stage: str) -> dict[str, Value]:
    """Measure a build; later stages replace measures of earlier ones.

    Args:
        build: The results of the build.
        stage: Its last stage.

    Raises:
        StorageError: A file is missing.
    """
    measures: dict[str, Value] = {}
    for name in MEASURED_STAGES[: MEASURED_STAGES.index(stage) + 1]:
        for key, (_, source) in _MEASURES[name].items():
            read = attrgetter(source) if isinstance(source, str) else source
            value: Value | Sized = read(build)
            if value is None or isinstance(value, float | int | str):
                measures[key] = value
            else:
                measures[key] = len(value)
    return measures
