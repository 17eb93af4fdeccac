"""Experiments from start to end: devices, units, cords, pictures, and the page of results."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...core.device.build_folder import REPRODUCED
from ...core.errors import ExperimentError
from ...core.machine.processes import one_blas_thread
from ...core.progress import Progress, silent
from ...core.storage.files import file_lock, storage_errors, write_json
from ...store.layout import LayoutRecord
from ...twin.devices.device_fields import share_fields
from .cord_experiment import run_cord_experiment
from .experiment import OPTIMISED, Experiment
from .layouts import build_layout, simulate_device
from .page import compare_number, write_page
from .page import format_number as format_number
from .pictures import draw_device_pictures
from .result_files import keep, load_kept
from .sessions import evaluate_unit, place_tags, twin_traits
from .unit import Unit

RESULTS, PAGE, WHOLE = "results.json", "index.html", "experiment.json"


def reproduce(
    experiments: Sequence[Experiment], out: Path, progress: Progress = silent
) -> dict[str, Any]:
    """Run experiments, and write `index.html` and `results.json` after each.

    Existing results are used if their inputs are unchanged. Other experiments of the same size
    that were run in the same folder stay on the page.

    Args:
        experiments: The experiments, all quick or all full (see `Experiment.at_size`).
        out: Folder of the results; each experiment has a folder in it.
        progress: Called with the progress.

    Returns:
        The results of the experiments in plain values, without pictures.

    Raises:
        DefsenseError: An experiment fails; those before it are on the page.
    """
    for experiment in experiments:
        if (out / experiment.name).resolve() == experiment.folder.resolve():
            raise ExperimentError(
                f"results would be written to {experiment.folder} itself",
                code="output-is-input",
                where=out,
                action="Choose another folder",
                experiment=experiment.name,
            )
    with storage_errors(out):
        out.mkdir(parents=True, exist_ok=True)
    lock = file_lock(
        out / REPRODUCED,
        "another run writes to this folder",
        code="output-in-use",
        where=out,
        action="Wait for it, or choose another folder",
    )
    steps = Steps(sum(map(_count_steps, experiments)), progress)
    quick, names = experiments[0].quick, [e.name for e in experiments]
    size = "quick" if quick else "full"
    with lock:
        kept = {p.parent.name: load_kept(p, size) for p in sorted(out.glob(f"*/{WHOLE}"))}
        results = {name: result for name, result in kept.items() if result is not None}
        order = [*names, *(n for n in results if n not in names)]
        for experiment in experiments:
            folder = out / experiment.name
            with storage_errors(folder):
                folder.mkdir(exist_ok=True)
            results[experiment.name] = reproduce_one(experiment, folder, steps)
            keep(folder / WHOLE, size, results[experiment.name])
            data = {"quick": quick, "experiments": [results[n] for n in order if n in results]}
            write_json(out / RESULTS, _without_pictures(data))
            write_page(out / PAGE, data)
    plain: dict[str, Any] = _without_pictures(
        {"quick": quick, "experiments": [results[n] for n in names]}
    )
    return plain


class Steps:
    """Reports the number and the name of each step of a run.

    Args:
        count: Number of all steps.
        progress: Called with the progress.
    """

    def __init__(self, count: int, progress: Progress) -> None:
        self._count, self._number, self._report = count, 0, progress

    @contextmanager
    def step(self, name: str) -> Iterator[Progress]:
        """Run a step; yields the function to which the step reports."""
        self._number += 1
        number = f"{self._number} of {self._count}"

        def report(stage: str, fraction: float, message: str) -> None:
            self._report(name, min(fraction, 0.999), f"{number}: {stage}: {message}")

        self._report(name, 0.0, f"{number}: started")
        yield report
        self._report(name, 1.0, "done")


def _count_steps(experiment: Experiment) -> int:
    """Return the number of steps: poses, tags, pictures, and each layout and its units."""
    layouts = len(experiment.file.layouts)
    return 3 + layouts * (1 + experiment.session.units) if layouts else 1


@one_blas_thread()
def reproduce_one(experiment: Experiment, out: Path, steps: Steps) -> dict[str, Any]:
    """Run one experiment.

    Args:
        experiment: The experiment.
        out: Its folder, which exists.
        steps: Receives the progress.

    Returns:
        Plain values: its description, the results by layout or cord, its numbers, and `pictures`
        as data URIs.

    Raises:
        DefsenseError: The experiment fails.
    """
    name, file = experiment.name, experiment.file
    if file.cords is not None:
        with steps.step(f"{name}: cords") as progress:
            results = run_cord_experiment(file.cords, experiment.quick, out, progress)
        rows = [compare_number(n, results["cords"]) for n in file.numbers]
        return {**_describe(experiment), **results, "numbers": rows}
    with steps.step(f"{name}: poses") as progress:
        simulated = simulate_device(experiment, out, progress)
    devices = {}
    for choice in file.layouts:
        with steps.step(f"{name}: {choice.name}") as progress:
            devices[choice.name] = build_layout(experiment, choice, simulated, out, progress)
    main = next((c for c in reversed(file.layouts) if c.cords == OPTIMISED), file.layouts[-1])
    with steps.step(f"{name}: tags") as progress:
        markers = place_tags(experiment, Unit(devices[main.name]), out, progress)
    units = {n: [Unit(d, 1 + k) for k in range(file.session.units)] for n, d in devices.items()}
    tests: dict[str, list[dict[str, Any]]] = {n: [] for n in devices}
    solved = None
    for number in range(1, file.session.units + 1):
        for layout, device in devices.items():
            with steps.step(f"{name}: {layout}, unit {number}") as progress:
                if solved is not None:
                    share_fields(solved, device)
                unit, tags = units[layout][number - 1], replace(markers, device=device.name)
                tests[layout].append(evaluate_unit(experiment, unit, tags, progress))
                solved = solved or device
    with steps.step(f"{name}: pictures") as progress:
        first = {n: some[0] for n, some in units.items()}
        pictures = draw_device_pictures(experiment, first, out, progress)
    layouts = {
        n: {"design": _describe_design(units[n][0].build.layout), "units": tests[n]} for n in units
    }
    return {
        **_describe(experiment),
        "layouts": layouts,
        "assumptions": [vars(a) for a in twin_traits(experiment, devices[main.name]).assumptions],
        "numbers": [compare_number(n, layouts) for n in file.numbers],
        "pictures": pictures,
    }


def _describe(experiment: Experiment) -> dict[str, Any]:
    file, plan = experiment.file, experiment.session
    keys = ("frames", "rate", "cameras", "tags", "units", "share")
    session = {key: getattr(plan, key) for key in keys}
    return {
        "name": experiment.name,
        "title": file.title,
        "figures": list(file.figures),
        "about": file.about,
        "quick": experiment.quick,
        "session": None if file.cords else {**session, "edge_length": experiment.edge_length},
        "choices": [{"name": c.name, "title": c.title, "cords": c.cords} for c in file.layouts],
    }


def _describe_design(layout: LayoutRecord) -> dict[str, Any]:
    """Return what the design of a layout predicts; lengths in mm."""
    p = layout.prediction
    return {
        "cords": len(layout.sensors),
        "lengths": [s.length for s in layout.by_channel()],
        "decoder": p.decoder,
        "predicted": p.unseen,
        "predicted_by_decoder": dict(layout.unseen),
        "fitted": p.rmse,
        "floor": p.floor,
        "band": [layout.band.low, layout.band.high],
        "largest_strain": max(s.peak_strain for s in layout.sensors),
        "warnings": list(layout.warnings),
    }


def _without_pictures(data: Any) -> Any:
    """Return plain values without pictures."""
    if isinstance(data, dict):
        return {k: _without_pictures(v) for k, v in data.items() if k != "pictures"}
    if isinstance(data, list | tuple):
        return [_without_pictures(v) for v in data]
    return data
