"""Stage 4: the cords' paths, and what they are predicted to sense."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np

from ...core.arrays import Float
from ...core.curve import distinct_planes, sample_path
from ...core.device.device import DECODERS, Device, Sensor
from ...core.errors import LayoutError
from ...decoding.ridge import KINDS
from ...geometry.bodies.body_record import load_body_record, load_surface
from ...geometry.bodies.meshing.mesh_file import load_mesh_record
from ...optimize.limits.verification import LayoutCheck, verify
from ...optimize.prediction.as_built import assumed_cords, scored_by_paths
from ...optimize.prediction.choose_layout import choose_layout
from ...optimize.prediction.design_task import SEED, DesignTask, decoders, load_task, tolerances_of
from ...optimize.prediction.predict import Scored, left_out_error, predict
from ...optimize.refinement.refine import OptimizedLayout, optimize_layout, report_part, evaluate_unchanged
from ...optimize.search.plane_directions import face_directions
from ...optimize.search.starting_layouts import FREE, Layout
from ...optimize.studies.risks import find_risks, check_cord_count
from ...optimize.studies.tolerance_monte_carlo import tolerance_band
from ...sensing.built_cord import BuiltCord
from ...sensing.layout import (
    BandRecord,
    CordPath,
    CordRecord,
    LayoutRecord,
    LimitsRecord,
    PredictionRecord,
    WeighedRecord,
    save_layout,
)
from ...sensing.response import mean_strain, strain_range
from ...sensing.weighed_layouts import WeighedCords, save_weighed
from .stages import Report, Seen, Watch

_SEARCHES, _FEWEST = 15, 5


def run(device: Device, folder: Path, report: Report, watch: Watch | None = None) -> None:
    """Find the layout, and save it with its prediction."""
    seen = _Watching(folder, watch)
    task = load_task(device, folder)
    surface, bay = load_surface(folder), load_body_record(folder).bay
    kinds = decoders(device, task)
    tried: dict[str, tuple[float, OptimizedLayout]] = {}
    for n, kind in enumerate(kinds):
        task = task.with_decoder(kind)
        like = next((k for k in tried if KINDS[k] is KINDS[kind]), None)  # designed alike
        show = partial(report_part, report, 0.4 * n / len(kinds), 0.4 * (n + 1) / len(kinds))
        found = tried[like][1] if like else _search(device, task, 0, device.planes, show, seen)
        scored = predict(task, assumed_cords(task, found.sensors))
        tried[kind] = (scored.prediction.unseen, found)
    decoder = min(tried, key=lambda k: tried[k][0])
    task = task.with_decoder(decoder)
    every = _again(device, task, tried[decoder][1], partial(report_part, report, 0.4, 0.8), seen)
    chosen, trials = choose_layout(
        device, task, [_as_kept(f) for f in every], surface, bay, partial(report_part, report, 0.8, 1.0)
    )
    found = chosen.found
    final = chosen.scored
    # Of those not designed for: what they would make of the cords chosen.
    decoded = {kind: task.with_decoder(kind) for kind in DECODERS}
    told = {kind: predict(t, final.cords).prediction for kind, t in decoded.items()}
    problem, tolerances = task.design, tolerances_of(device)
    initial = scored_by_paths(device, task, surface, found.initial, bay)
    check = verify(found.sensors, surface, problem.limits)
    if check.problems:
        raise LayoutError(
            f"the optimised layout fails its check: {check.problems[0]}",
            code=check.problems[0].code,
        )
    sensors = _cords(device, found.sensors, check, task, final)
    layout = LayoutRecord(
        device=device.name,
        mesh=load_mesh_record(folder).hash,
        limits=LimitsRecord(
            problem.limits.wall, problem.limits.min_radius, problem.limits.clearance
        ),
        response=device.cord.measured,
        sensors=sensors,
        min_clearance=check.min_clearance,
        warnings=(
            *map(str, find_risks(problem, found.sensors)),
            *map(
                str,
                check_cord_count(
                    task.everything,
                    final.prediction,
                    min(p.unseen_noise_free for p in told.values()),
                ),
            ),
            *_uncalibrated(device, sensors),
        ),
        weighed=tuple(
            WeighedRecord(
                t.designed,
                None if t.problem else t.built,
                t.planes,
                t.slanted,
                t.parts,
                t.smallest,
                t.free_ends,
                t.warnings,
                t.problem,
                t is chosen,
            )
            for t in trials
        ),
        prediction=final.prediction,
        unseen={kind: p.unseen for kind, p in told.items()},
        cross_validated={k: left_out_error(t, final.cords) for k, t in decoded.items()},
        band=BandRecord(
            **asdict(
                tolerance_band(
                    task.everything,
                    final.cords,
                    task.reading,
                    np.random.default_rng(SEED),
                    task.unseen,
                    tolerances=tolerances,
                )
            ),
            **asdict(tolerances),
        ),
        initial=initial.prediction,
        drawn=tuple(sample_path(s) for s in found.initial),
        proposed=device.propose > 0,
        starts=tuple(found.starts),
        seed=device.seed,
    )
    prediction = PredictionRecord(
        task.points, task.names, final.signals, final.errors, final.decoder.to_json()
    )
    save_layout(folder, layout, prediction)
    paths = tuple(tuple(CordPath.of(s) for s in t.found.sensors) for t in trials)
    save_weighed(folder, WeighedCords(paths))


def _as_kept(found: OptimizedLayout) -> OptimizedLayout:
    """With the planes' frames as `layout.json` gives them back, to the last digit: on that a cut
    along faces that touch may turn, and what was made on trial is made again from the file."""
    cords = [replace(s, plane=CordPath.of(s).sensor().plane) for s in found.sensors]
    return replace(found, sensors=tuple(cords))


class _Watching:
    """Searches as one may watch them: None for a search that nobody does."""

    def __init__(self, folder: Path, watch: Watch | None) -> None:
        self.kept = None if watch is None else self._teller(folder, watch, kept=True)
        self.passed = None if watch is None else self._teller(folder, watch, kept=False)

    @staticmethod
    def _teller(folder: Path, watch: Watch, *, kept: bool) -> Callable[[Layout, float], None]:
        return lambda layout, rmse: watch(Seen(folder, tuple(layout), rmse, kept))


def searches(cords: int) -> int:
    """How many searches, whose random choices differ, the best of which are weighed against each
    other: the fewer cords, the less time each takes, and the more a single one decides."""
    return max(_SEARCHES // cords, _FEWEST)


def _search(
    device: Device,
    task: DesignTask,
    seed: int,
    planes: int | None,
    report: Report,
    seen: _Watching,
    normals: Float | None = None,
) -> OptimizedLayout:
    rng = np.random.default_rng((device.seed, seed))
    return optimize_layout(
        task.design,
        device.sensors,
        rng,
        report,
        extra=device.propose,
        planes=planes,
        normals=normals,
        watch=seen.kept,
        follow=seen.passed,
    )


def _again(
    device: Device, task: DesignTask, first: OptimizedLayout, report: Report, seen: _Watching
) -> list[OptimizedLayout]:
    """The layout, what it set out from if that keeps the limits, and layouts of other seeds, of
    fewer planes and of planes along the body's faces, where there is anything to search."""
    out = [first]
    if not (device.propose or any(s.free for s in device.sensors)):
        return out
    begun = evaluate_unchanged(task.design, tuple(first.initial))
    out += [begun] if begun else []
    fewer = range(1, len(distinct_planes([s.plane for s in first.sensors])))
    todo: list[tuple[int, int | None, Float | None]]
    count = device.searches or searches(len(first.sensors))
    todo = [(seed, device.planes, None) for seed in range(1, count)]
    todo += [(0, n, None) for n in fewer if device.planes is None or n < device.planes]
    free = device.planes is None and any(s.free == FREE for s in device.sensors)
    if device.propose or free:
        todo.append((0, device.planes, face_directions(task.design.surface)))
    if device.searches is not None:  # simple layouts first: what cannot be made is of no use
        todo = todo[::-1][: device.searches - 1]
    for k, (seed, planes, normals) in enumerate(todo):
        show = partial(report_part, report, k / len(todo), (k + 1) / len(todo))
        with suppress(LayoutError):  # no room in so few planes
            out.append(_search(device, task, seed, planes, show, seen, normals))
    return out


def _cords(
    device: Device,
    sensors: Sequence[Sensor],
    check: LayoutCheck,
    task: DesignTask,
    scored: Scored,
) -> tuple[CordRecord, ...]:
    out = []
    rows = zip(sensors, check.cords, scored.cords, scored.prediction.noise, strict=True)
    for channel, (s, c, built, noise) in enumerate(rows):
        least, most = _strains(built, task.everything.deform(built.path))
        out.append(
            CordRecord(
                **vars(CordPath.of(s)),
                channel=channel,
                points=sample_path(s),
                length=c.length,
                min_radius=min(c.min_radius, 1e6),
                min_wall=c.min_wall,
                inlets=c.inlets,
                cord_diameter=device.cord.diameter,
                peak_strain=most,
                least_strain=least,
                stretch=built.path,
                series=built.series,
                prestretch=built.prestretch,
                noise=noise,
            )
        )
    return tuple(out)


def _strains(cord: BuiltCord, deformed: Float) -> tuple[float, float]:
    """Least and greatest strain of the cord itself over rest and all states (s, p, 3): of any
    segment of a bonded one, and below zero where a held one would be slack."""
    if cord.prestretch is None:
        least, most = strain_range(cord.path, deformed)
        return min(least, 0.0), max(most, 0.0)
    mean = (1 + cord.prestretch) * (1 + np.append(0.0, mean_strain(cord.path, deformed))) - 1
    return float(mean.min()), float(mean.max())


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
