"""Stage 4: the cords' paths, and what they are predicted to sense."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np

from ...core.curve import distinct
from ...core.device import DECODERS, Device, Sensor
from ...core.errors import LayoutError
from ...core.path_sampling import sample_path
from ...decoding.features import KINDS
from ...optimize.limits.verification import LayoutCheck, verify
from ...optimize.problem.problem import Problem
from ...optimize.refinement.refine import Optimised, optimise, part
from ...optimize.studies.risks import risks
from ...optimize.studies.tolerance_monte_carlo import Tolerances, tolerance_band
from ...sensing.signal import strain_range
from ..artifacts.body import load_body_record, load_surface
from ..artifacts.layout import (
    BandRecord,
    CordPath,
    CordRecord,
    LayoutRecord,
    LimitsRecord,
    PredictionRecord,
    WeighedRecord,
    save_layout,
)
from ..artifacts.mesh import load_mesh_record
from ..design.choose_layout import choose_layout
from ..design.design_task import SEED, DesignTask, load_task
from ..design.predict import predict, unseen_error
from .stages import Report

#: Searches, whose random choices differ; the best are weighed against each other.
SEEDS = 3


def run(device: Device, folder: Path, report: Report) -> None:
    """Find the layout, and save it with its prediction."""
    task = load_task(device, folder)
    surface, bay = load_surface(folder), load_body_record(folder).bay
    kinds = DECODERS if device.decoder == "auto" else (device.decoder,)
    tried: dict[str, tuple[float, Optimised]] = {}
    for n, kind in enumerate(kinds):
        task = task.decoded_by(kind)
        like = next((k for k in tried if KINDS[k] is KINDS[kind]), None)  # designed alike
        show = partial(part, report, 0.4 * n / len(kinds), 0.4 * (n + 1) / len(kinds))
        found = tried[like][1] if like else _search(device, task, 0, device.planes, show)
        tried[kind] = (unseen_error(task, found.sensors), found)
    decoder = min(tried, key=lambda k: tried[k][0])
    task = task.decoded_by(decoder)
    every = _again(device, task, tried[decoder][1], partial(part, report, 0.4, 0.8))
    chosen, trials = choose_layout(
        device, task, every, surface, bay, partial(part, report, 0.8, 1.0)
    )
    found = chosen.found
    errors = {  # of those not designed for: what they would make of the cords chosen
        kind: unseen_error(task.decoded_by(kind), found.sensors) for kind in DECODERS
    }
    problem = task.design
    initial = predict(task, [sample_path(s) for s in found.initial])
    final = predict(task, [sample_path(s) for s in found.sensors])
    check = verify(found.sensors, surface, problem.limits)
    if check.problems:
        raise LayoutError(f"the optimised layout fails its check: {check.problems[0]}")
    sensors = _cords(device, found.sensors, check, task.everything)
    layout = LayoutRecord(
        device=device.name,
        mesh=load_mesh_record(folder).hash,
        limits=LimitsRecord(
            problem.limits.wall, problem.limits.min_radius, problem.limits.clearance
        ),
        sensors=sensors,
        min_clearance=check.min_clearance,
        warnings=(*risks(problem, found.sensors), *_uncalibrated(device, sensors)),
        weighed=tuple(
            WeighedRecord(
                t.designed,
                t.built,
                t.planes,
                t.parts,
                t.smallest,
                t.warnings,
                t.problem,
                t is chosen,
            )
            for t in trials
        ),
        prediction=final.prediction,
        cross_validated=errors,
        band=BandRecord(
            **asdict(
                tolerance_band(
                    task.everything, found.sensors, np.random.default_rng(SEED), task.unseen
                )
            ),
            **asdict(Tolerances()),
        ),
        initial=initial.prediction,
        drawn=tuple(sample_path(s) for s in found.initial),
        proposed=device.propose > 0,
        starts=tuple(found.starts),
        seed=SEED,
    )
    prediction = PredictionRecord(
        task.points, task.names, final.signals, final.errors, final.decoder.to_json()
    )
    save_layout(folder, layout, prediction)


def _search(
    device: Device, task: DesignTask, seed: int, planes: int | None, report: Report
) -> Optimised:
    rng = np.random.default_rng((SEED, seed))
    return optimise(task.design, device.sensors, rng, report, extra=device.propose, planes=planes)


def _again(device: Device, task: DesignTask, first: Optimised, report: Report) -> list[Optimised]:
    """The layout, those of other seeds and of fewer planes, where there is anything to search."""
    out = [first]
    if not (device.propose or any(s.free for s in device.sensors)):
        return out
    fewer = range(1, len(distinct([s.plane for s in first.sensors])))
    todo = [(seed, device.planes) for seed in range(1, SEEDS)]
    todo += [(0, n) for n in fewer if device.planes is None or n < device.planes]
    for k, (seed, planes) in enumerate(todo):
        show = partial(part, report, k / len(todo), (k + 1) / len(todo))
        with suppress(LayoutError):  # no room in so few planes
            out.append(_search(device, task, seed, planes, show))
    return out


def _cords(
    device: Device, sensors: Sequence[Sensor], check: LayoutCheck, problem: Problem
) -> tuple[CordRecord, ...]:
    out = []
    for channel, (s, c) in enumerate(zip(sensors, check.cords, strict=True)):
        path = sample_path(s)
        least, most = strain_range(path, problem.deform(path))
        out.append(
            CordRecord(
                **vars(CordPath.of(s)),
                channel=channel,
                points=path,
                length=c.length,
                min_radius=min(c.min_radius, 1e6),
                min_wall=c.min_wall,
                inlets=c.inlets,
                cord_diameter=device.cord.diameter,
                peak_strain=most,
                least_strain=least,
            )
        )
    return tuple(out)


def _uncalibrated(device: Device, sensors: Sequence[CordRecord]) -> list[str]:
    """Warnings: cords that leave the strains in which their response was measured."""
    low, high = device.cord.response.strain_range
    out = []
    for s in sensors:
        least, most = s.least_strain, s.peak_strain
        if least < low or most > high:
            out.append(
                f"cord {s.name!r}: strains of {least:.1%} to {most:.1%} leave the calibrated"
                f" range of {low:.1%} to {high:.1%}; beyond it the response is continued along its"
                " tangent: measure on tighter jigs, or trust the prediction less"
            )
    return out
