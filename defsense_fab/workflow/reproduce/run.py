"""Experiments from beginning to end: devices, units, cords, pictures, and the page of all."""

from __future__ import annotations

from collections.abc import Sequence
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
from .cords.cord_experiment import cord_results
from .devices.causes import kept_causes
from .devices.layouts import built_layout, simulated_device
from .devices.pictures import device_pictures
from .devices.sessions import tags_of, tested_unit, traits_of
from .experiments.experiment import OPTIMISED, Experiment
from .results.kept import keep, kept
from .results.numbers import as_row, compared
from .results.page import write_page
from .time_left import TimeLeft

RESULTS, PAGE, WHOLE = "results.json", "index.html", "experiment.json"


def reproduce(
    experiments: Sequence[Experiment], out: Path, progress: Progress = silent
) -> dict[str, Any]:
    """Run the experiments, as they are sized, into folders of `out`, and write `index.html` and
    `results.json` there after each; what is there already is taken where all that it was made from
    is unchanged. Other experiments of this size that were made there before stay on the page. The
    results in plain values. Raises a DefsenseError where one fails: those before it are on the
    page."""
    left = TimeLeft([step for e in experiments for step in _steps(e)], progress)
    for e in experiments:
        if (out / e.name).resolve() == e.folder.resolve():
            raise ExperimentError(
                f"{out}: results would go into {e.folder} itself; give another --out"
            )
    with storage_errors(out):
        out.mkdir(parents=True, exist_ok=True)
    with file_lock(out / REPRODUCED, f"{out}: another run writes there; wait for it, or give --out"):
        quick = experiments[0].quick
        before, asked = _made_before(out, quick), [e.name for e in experiments]
        order = [*asked, *(n for n in before if n not in asked)]
        done = dict(before)
        for experiment in experiments:
            folder = out / experiment.name
            with storage_errors(folder):
                folder.mkdir(exist_ok=True)
            done[experiment.name] = reproduce_one(experiment, folder, left)
            keep(folder / WHOLE, _size(quick), done[experiment.name])
            data = {"quick": quick, "experiments": [done[n] for n in order if n in done]}
            write_json(out / RESULTS, _without_pictures(data))
            write_page(out / PAGE, data)
    made = {"quick": quick, "experiments": [done[n] for n in asked]}
    plain: dict[str, Any] = _without_pictures(made)
    return plain


def _made_before(out: Path, quick: bool) -> dict[str, dict[str, Any]]:
    """What `reproduce_one` gave in folders of `out`, by the experiments' names."""
    found = {p.parent.name: kept(p, _size(quick)) for p in sorted(out.glob(f"*/{WHOLE}"))}
    return {name: whole for name, whole in found.items() if whole is not None}


def _size(quick: bool) -> str:
    return "quick" if quick else "full"


def _steps(experiment: Experiment) -> list[str]:
    """Names of all that there is to do."""
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
    experiment: Experiment, out: Path, left: TimeLeft | None = None
) -> dict[str, Any]:
    """One experiment into its folder, which is there: its description, what came out by layout or
    cord, and its numbers, in plain values, with `pictures` as data URIs. Raises a DefsenseError
    where it fails."""
    left = left or TimeLeft(_steps(experiment), silent)
    told = _told(experiment)
    if experiment.cords is not None:
        with left.step(f"{experiment.name}: cords") as progress:
            found = cord_results(experiment.cords, experiment.quick, out, progress)
        rows = [as_row(c) for c in compared(experiment, found["cords"])]
        return {**told, **found, "numbers": rows}
    name = experiment.name
    with left.step(f"{name}: poses") as progress:
        simulated = simulated_device(experiment, out, progress)
    devices: dict[str, Device] = {}
    for choice in experiment.layouts:
        with left.step(f"{name}: {choice.name}") as progress:
            devices[choice.name] = built_layout(experiment, choice, simulated, out, progress)
    optimised = [c.name for c in experiment.layouts if c.cords == OPTIMISED]
    explained = (optimised or [c.name for c in experiment.layouts])[-1]  # its causes are told
    first = devices[explained]
    markers = tags_of(experiment, first, out, left.progress)
    units: dict[str, list[dict[str, Any]]] = {n: [] for n in devices}
    before: Device | None = None
    for unit in range(1, experiment.session.units + 1):
        for layout, device in devices.items():
            with left.step(f"{name}: {layout}, unit {unit}") as progress:
                if before is not None:
                    share_fields(before, device)
                own = replace(markers, device=device.name)
                units[layout].append(tested_unit(experiment, device, own, unit, progress))
                before = before or device
    results: dict[str, dict[str, Any]] = {
        n: {"design": _design(d), "units": units[n]} for n, d in devices.items()
    }
    with left.step(f"{name}: causes") as progress:
        own = replace(markers, device=first.name)
        results[explained]["causes"] = kept_causes(experiment, first, own, progress)
    with left.step(f"{name}: pictures") as progress:
        pictures = device_pictures(experiment, devices, out, progress)
    return {
        **told,
        "layouts": results,
        "assumptions": [vars(a) for a in traits_of(experiment, first).assumptions],
        "numbers": [as_row(c) for c in compared(experiment, results)],
        "pictures": pictures,
    }


def _told(experiment: Experiment) -> dict[str, Any]:
    e, s = experiment, experiment.session
    return {
        "name": e.name, "title": e.title, "figures": list(e.figures), "about": e.about,
        "quick": e.quick,
        "session": None if e.cords else {
            "frames": s.frames, "rate": s.rate, "cameras": s.cameras, "tags": s.tags,
            "units": s.units, "share": s.share, "edge_length": e.edge_length,
        },
        "choices": [
            {"name": c.name, "title": c.title, "cords": c.cords} for c in e.layouts
        ],
    }  # fmt: skip


def _design(device: Device) -> dict[str, Any]:
    """What the design of a layout promises, mm."""
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
    """In plain values."""
    if isinstance(data, dict):
        return {k: _without_pictures(v) for k, v in data.items() if k != "pictures"}
    if isinstance(data, list | tuple):
        return [_without_pictures(v) for v in data]
    return data
