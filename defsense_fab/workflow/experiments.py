"""Experiments of the paper and calibrations of cords, for the Python interface."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..core.errors import CalibrationError, ExperimentError
from ..core.progress import Progress, silent
from ..twin.calibration_session import record_twin
from ..twin.electronics.cords import CordTraits
from .arguments import called, listed, number, of_kind, path, truth, whole
from .calibrate.fit_response import FittedResponse
from .calibrate.fit_response import fit_response as fit_sources
from .reproduce import run
from .reproduce.cord_experiment import make_true_response
from .reproduce.experiments import experiment_file
from .reproduce.experiments.experiment import Experiment


def load_experiment(
    folder: str | Path, *, quick: bool = False, units: int | None = None
) -> Experiment:
    """Load an experiment of the paper (docs/reproduce.md).

    Args:
        folder: Folder with `experiment.toml`, such as `examples/bar`.
        quick: Whether to use the small size of the experiment, which takes minutes, not hours.
        units: Number of units of each device; None: that of the file.

    Returns:
        The experiment, for `reproduce`.

    Raises:
        ExperimentError: The file does not exist or is invalid (with line and key), or an argument
            is invalid.
    """
    source = path(folder, "folder", ExperimentError)
    is_quick = truth(quick, "quick", ExperimentError)
    count = None if units is None else whole(units, "units", ExperimentError)
    return experiment_file.load_experiment(source).at_size(quick=is_quick, units=count)


def reproduce(
    experiment: Experiment, out: str | Path, progress: Progress = silent
) -> dict[str, Any]:
    """Run an experiment of the paper, as `defsense reproduce` does.

    Every layout is built as a device, recorded by its simulated twin, trained on and tested.
    Results that are up to date are reused.

    Args:
        experiment: The experiment, from `load_experiment`.
        out: Folder of the results. The experiment gets a folder in it; `index.html` shows all
            experiments in `out`.
        progress: Receives each step's name, completed fraction and a message.

    Returns:
        The experiment's part of `results.json`. `layouts` has by layout the `units`, each with the
        errors in mm of its `chosen` decoder (`rmse`, `deviation`, `peak`).

    Raises:
        DefsenseError: The experiment failed; ExperimentError if an argument is invalid.
    """
    of_kind(experiment, "experiment", Experiment, ExperimentError)
    folder = path(out, "out", ExperimentError)
    called(progress, ExperimentError)
    results: dict[str, Any] = run.reproduce([experiment], folder, progress)["experiments"][0]
    return results


def record_specimen_twin(
    folder: str | Path, *, k_res: float, length: float = 150.0, seed: int = 1
) -> Path:
    """Record a calibration session on a simulated bending specimen with its cords.

    The response of the cords has the slope `k_res` at rest and bends off exponentially, unlike all
    models that are fitted.

    Args:
        folder: New folder of the session.
        k_res: Slope of (R - R0)/R0 over strain at rest.
        length: Length of the specimen, mm.
        seed: Seed of the pieces of cord and of their noise.

    Returns:
        The folder, for `fit_response`.

    Raises:
        CalibrationError: An argument is invalid, or the folder has a session.
        StorageError: The session cannot be written.
    """
    session = path(folder, "folder", CalibrationError)
    slope = number(k_res, "k_res", CalibrationError, above=0)
    length_mm = number(length, "length", CalibrationError, above=0)
    start = whole(seed, "seed", CalibrationError)
    record_twin(session, CordTraits(make_true_response(slope)), seed=start, length=length_mm)
    return session


def fit_response(
    sources: Sequence[str | Path], out: str | Path | None = None, progress: Progress = silent
) -> FittedResponse:
    """Fit the response of a cord to calibration sessions, as `defsense calibrate fit` does.

    Args:
        sources: Folders of sessions, and CSV tables of readings (docs/calibration.md).
        out: File to write, such as `response.json`; its report is written next to it.
        progress: Receives each step's name, completed fraction and a message.

    Returns:
        The response: `data` is the content of `response.json` with `k_res`, its 95 % `interval`
        and the `reason` for the chosen model.

    Raises:
        CalibrationError: A source cannot be read or used, or an argument is invalid.
        StorageError: A file cannot be written.
    """
    items = listed(sources, "sources", CalibrationError)
    files = [path(item, f"sources[{k}]", CalibrationError) for k, item in enumerate(items)]
    target = None if out is None else path(out, "out", CalibrationError)
    called(progress, CalibrationError)
    return fit_sources(files, out=target, progress=progress)
