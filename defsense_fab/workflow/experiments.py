"""Experiments of the paper and calibrations of cords, for the Python interface."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..core.errors import CalibrationError, ExperimentError
from ..core.progress import Progress, silent
from ..core.response import ResponseSpec
from . import arguments
from .arguments import called, listed, of_kind, path, truth, whole
from .calibrate import simulated_specimens
from .calibrate.fit_response import FittedResponse
from .calibrate.fit_response import fit_response as fit_sources
from .calibrate.options import FitOptions, SimulatedSpecimenOptions
from .reproduce import experiment_file, run
from .reproduce.experiment import Experiment
from .reproduce.options import ReproduceOptions


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
    options = ReproduceOptions(quick=is_quick, units=count)
    experiment = experiment_file.load_experiment(source)
    return experiment.at_size(quick=options.quick, units=options.units)


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


def simulate_specimens(
    folder: str | Path, response: ResponseSpec | None = None, **options: Any
) -> list[Path]:
    """Simulate calibration sessions on bending specimens, as `defsense calibrate twin` does.

    Args:
        folder: Folder of the sessions.
        response: Response of the cord; None for that of the options `k` and `q`.
        **options: Fields of `SimulatedSpecimenOptions`, such as `k=2.5` and `lengths=(150, 200)`.

    Returns:
        The folders of the sessions, for `fit_response`.

    Raises:
        CalibrationError: An argument is invalid, or a session exists already.
        StorageError: A session cannot be written.
    """
    parent = path(folder, "folder", CalibrationError)
    if response is not None:
        of_kind(response, "response", ResponseSpec, CalibrationError)
    record = arguments.options(options, SimulatedSpecimenOptions, CalibrationError)
    return simulated_specimens.simulate_specimens(parent, record, response=response)


def fit_response(
    sources: Sequence[str | Path],
    out: str | Path | None = None,
    progress: Progress = silent,
    **options: Any,
) -> FittedResponse:
    """Fit the response of a cord to calibration sessions, as `defsense calibrate fit` does.

    Args:
        sources: Folders of sessions, and CSV tables of readings (docs/calibration.md).
        out: File to write, such as `response.json`; its report is written next to it.
        progress: Receives each step's name, completed fraction and a message.
        **options: Fields of `FitOptions`, such as `model="line"`.

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
    record = arguments.options(options, FitOptions, CalibrationError)
    return fit_sources(files, target, options=record, progress=progress)
