"""Experiments from start to end: devices, units, cords, pictures, and the page of results."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...core.device.build_folder import REPRODUCED, build_folder
from ...core.device.device import Device
from ...core.errors import ExperimentError
from ...core.machine.processes import one_blas_thread
from ...core.progress import Progress, silent
from ...core.storage.files import file_lock, storage_errors, write_json
from ...store.layout import load_layout
from ...twin.devices.device_fields import share_fields
from .cord_experiment import run_cord_experiment
from .devices.layouts import build_layout, simulate_device
from .devices.pictures import draw_device_pictures
from .devices.sessions import evaluate_unit, find_error_causes, place_tags, twin_traits
from .experiments.experiment import OPTIMISED, Experiment
from .results.numbers import as_row, compare_numbers
from .results.page import write_page
from .results.result_files import keep, load_kept

RESULTS, PAGE, WHOLE = "results.json", "index.html", "experiment.json"
MIN_STEP_S = 1.0  # faster steps found their results made; they say nothing of other steps


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
    steps = StepProgress([step for e in experiments for step in _list_steps(e)], progress)
    with storage_errors(out):
        out.mkdir(parents=True, exist_ok=True)
    lock = file_lock(
        out / REPRODUCED,
        "another run writes to this folder",
        code="output-in-use",
        where=out,
        action="Wait for it, or choose another folder",
    )
    with lock:
        quick = experiments[0].quick
        earlier, names = _load_earlier(out, quick), [e.name for e in experiments]
        order = [*names, *(n for n in earlier if n not in names)]
        results = dict(earlier)
        for experiment in experiments:
            folder = out / experiment.name
            with storage_errors(folder):
                folder.mkdir(exist_ok=True)
            results[experiment.name] = reproduce_one(experiment, folder, steps)
            keep(folder / WHOLE, _size(quick), results[experiment.name])
            data = {"quick": quick, "experiments": [results[n] for n in order if n in results]}
            write_json(out / RESULTS, _without_pictures(data))
            write_page(out / PAGE, data)
    plain: dict[str, Any] = _without_pictures(
        {"quick": quick, "experiments": [results[n] for n in names]}
    )
    return plain


def _load_earlier(out: Path, quick: bool) -> dict[str, dict[str, Any]]:
    """Return the results of `reproduce_one` in folders of `out`, by name."""
    paths = sorted(out.glob(f"*/{WHOLE}"))
    results = {p.parent.name: load_kept(p, _size(quick)) for p in paths}
    return {name: result for name, result in results.items() if result is not None}


def _size(quick: bool) -> str:
    return "quick" if quick else "full"


def _list_steps(experiment: Experiment) -> list[str]:
    """Return the names of all steps of an experiment."""
    name = experiment.name
    if experiment.cords is not None:
        return [f"{name}: cords"]
    layouts = [c.name for c in experiment.layouts]
    units = range(1, experiment.session.units + 1)
    return [
        f"{name}: poses",
        *(f"{name}: {layout}" for layout in layouts),
        *(f"{name}: {layout}, unit {u}" for u in units for layout in layouts),
        f"{name}: causes",
        f"{name}: pictures",
    ]


@one_blas_thread()
def reproduce_one(
    experiment: Experiment, out: Path, steps: StepProgress | None = None
) -> dict[str, Any]:
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
    steps = steps or StepProgress(_list_steps(experiment), silent)
    if experiment.cords is not None:
        with steps.step(f"{experiment.name}: cords") as progress:
            results = run_cord_experiment(experiment.cords, experiment.quick, out, progress)
        rows = [as_row(c) for c in compare_numbers(experiment, results["cords"])]
        return {**_describe(experiment), **results, "numbers": rows}
    devices = _build_devices(experiment, out, steps)
    optimized = [c.name for c in experiment.layouts if c.cords == OPTIMISED]
    explained = (optimized or [c.name for c in experiment.layouts])[-1]
    first = devices[explained]
    markers = place_tags(experiment, first, out, steps.progress)
    units: dict[str, list[dict[str, Any]]] = {n: [] for n in devices}
    solved: Device | None = None
    for unit in range(1, experiment.session.units + 1):
        for layout, device in devices.items():
            with steps.step(f"{experiment.name}: {layout}, unit {unit}") as progress:
                if solved is not None:
                    share_fields(solved, device)
                tags = replace(markers, device=device.name)
                units[layout].append(evaluate_unit(experiment, device, tags, unit, progress))
                solved = solved or device
    layouts: dict[str, dict[str, Any]] = {
        n: {"design": _describe_design(d), "units": units[n]} for n, d in devices.items()
    }
    with steps.step(f"{experiment.name}: causes") as progress:
        tags = replace(markers, device=first.name)
        layouts[explained]["causes"] = find_error_causes(experiment, first, tags, progress)
    with steps.step(f"{experiment.name}: pictures") as progress:
        pictures = draw_device_pictures(experiment, devices, out, progress)
    return {
        **_describe(experiment),
        "layouts": layouts,
        "assumptions": [vars(a) for a in twin_traits(experiment, first).assumptions],
        "numbers": [as_row(c) for c in compare_numbers(experiment, layouts)],
        "pictures": pictures,
    }


def _build_devices(experiment: Experiment, out: Path, steps: StepProgress) -> dict[str, Device]:
    """Return the built device of each layout."""
    with steps.step(f"{experiment.name}: poses") as progress:
        simulated = simulate_device(experiment, out, progress)
    devices: dict[str, Device] = {}
    for choice in experiment.layouts:
        with steps.step(f"{experiment.name}: {choice.name}") as progress:
            devices[choice.name] = build_layout(experiment, choice, simulated, out, progress)
    return devices


def _describe(experiment: Experiment) -> dict[str, Any]:
    e, s = experiment, experiment.session
    session = {
        "frames": s.frames,
        "rate": s.rate,
        "cameras": s.cameras,
        "tags": s.tags,
        "units": s.units,
        "share": s.share,
        "edge_length": e.edge_length,
    }
    return {
        "name": e.name,
        "title": e.title,
        "figures": list(e.figures),
        "about": e.about,
        "quick": e.quick,
        "session": None if e.cords else session,
        "choices": [{"name": c.name, "title": c.title, "cords": c.cords} for c in e.layouts],
    }


def _describe_design(device: Device) -> dict[str, Any]:
    """Return what the design of a layout predicts; lengths in mm."""
    layout = load_layout(build_folder(device))
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


class StepProgress:
    """Reports steps by number and name, with an estimate of the remaining time.

    The estimate uses the durations of steps of the same kind: the kind is the end of a step's name
    ("unit 1", "pictures") without its number.

    Args:
        steps: Names of all steps.
        progress: Called with the progress.
    """

    def __init__(self, steps: Sequence[str], progress: Progress) -> None:
        self._remaining, self._count = list(steps), max(len(steps), 1)
        self._report, self._stage = progress, ""
        self._durations: dict[str, list[float]] = {}

    @contextmanager
    def step(self, name: str) -> Iterator[Progress]:
        """Run a step; yields the function to which the step reports."""
        self._stage, started_at = name, time.monotonic()
        self._report(name, 0.0, self._format("started"))
        yield self.progress
        if name in self._remaining:
            self._remaining.remove(name)
        duration = time.monotonic() - started_at
        if duration > MIN_STEP_S:
            self._durations.setdefault(_step_kind(name), []).append(duration)
        self._report(name, 1.0, "done")

    def progress(self, stage: str, fraction: float, message: str) -> None:
        """Report the progress within the current step."""
        self._report(self._stage, min(fraction, 0.999), self._format(f"{stage}: {message}"))

    def remaining_s(self) -> float | None:
        """Return the time of the remaining steps with the current one, s; None if unknown."""
        durations = [d for some in self._durations.values() for d in some]
        if not durations:
            return None
        mean = sum(durations) / len(durations)
        by_kind = {kind: sum(some) / len(some) for kind, some in self._durations.items()}
        return sum(by_kind.get(_step_kind(name), mean) for name in self._remaining)

    def _format(self, message: str) -> str:
        number = self._count - len(self._remaining) + 1
        remaining = self.remaining_s()
        estimate = "" if remaining is None else f", about {max(round(remaining / 60), 1)} min left"
        return f"{number} of {self._count}{estimate}: {message}"


def _step_kind(name: str) -> str:
    return name.rpartition(": ")[2].rpartition(", ")[2].rstrip("0123456789 ")
