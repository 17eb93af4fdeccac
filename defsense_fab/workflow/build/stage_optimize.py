"""Stage 4: route the cords, and predict what they sense."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ...core.arrays import Float
from ...core.curve import sample_path
from ...core.device.device import DECODERS, Device, Sensor
from ...core.errors import FabricationError, LayoutError
from ...core.progress import subrange
from ...decoding.ridge import FEATURES
from ...geometry.parts.records import PartSet
from ...optimization.limits.verification import LayoutCheck, verify
from ...optimization.prediction.as_built import assumed_cords, score_paths
from ...optimization.prediction.built_devices import predict_built_devices
from ...optimization.prediction.choose_layout import Trial, choose_layout
from ...optimization.prediction.design_task import (
    DesignTask,
    candidate_decoders,
    check_exits,
    load_task,
)
from ...optimization.prediction.predict import ScoredLayout, left_out_error, predict
from ...optimization.refinement.refine import (
    OptimizedLayout,
    evaluate_unchanged,
    improve_layout,
    require_drawing,
)
from ...optimization.studies.risks import check_cord_count, find_risks
from ...sensing.built_cord import BuiltCord
from ...sensing.response import mean_strain, segment_strain_range
from ...store.build import Build
from ...store.forces import save_forces
from ...store.layout import (
    CordPath,
    CordRecord,
    LayoutRecord,
    LimitsRecord,
    PredictionRecord,
    WeighedCords,
    WeighedRecord,
    save_layout,
    save_weighed,
)
from ..design.session_shares import session_shares
from ..fabrication.print_time import pieces_of_parts
from .continued_layout import EarlierLayout
from .drawing_repair import describe_repairs, repair_drawing
from .layout_searches import MapTasks, Search, SearchObserver, SearchRunner
from .offered_layout import keep_search, take_offer
from .pose_forces import pose_forces
from .search_plan import default_searches, is_searched, search_alternatives, search_more
from .stages import Report, Watch
from .traced_poses import MIN_SIGNAL_CHANGE, Stiffening, stiffen, use_plain_fields


@dataclass(frozen=True)
class Winner:
    """The parts of the chosen layout, made on trial while it was chosen.

    Attributes:
        device: The device with its strain relief decided.
        notes: Why the strain relief was decided so.
        parts: The parts, without exact solids.
        task: The design task, with the layout's decoder.
    """

    device: Device
    notes: tuple[str, ...]
    parts: PartSet
    task: DesignTask


def run(
    device: Device,
    build: Build,
    report: Report,
    watch: Watch | None = None,
    earlier: EarlierLayout | None = None,
    map_tasks: MapTasks | None = None,
) -> Winner | None:
    """Find the layout, and save it with its prediction.

    Args:
        device: The device.
        build: Results of the earlier stages.
        report: Receives the completed fraction and a message.
        watch: Receives the layouts that the searches reach.
        earlier: A layout to continue from; None to search.
        map_tasks: Runs the searches on a cluster; None for this machine.

    Returns:
        The parts of the chosen layout; None if no layout can be made.

    Raises:
        LayoutError: No layout keeps the limits.
        DeviceError: The regions of exits have no room on the skin.
    """
    check_exits(device, build.surface)
    observer = SearchObserver(build.folder, watch)
    use_plain_fields(build)
    task = load_task(device, build)
    drawn = device.sensors
    device, repairs = repair_drawing(device, task, report)

    def choose(
        task: DesignTask, found: Sequence[OptimizedLayout]
    ) -> tuple[Trial, tuple[Trial, ...]]:
        stored, show = [as_stored(c) for c in found], subrange(report, 0.8, 1.0)
        return choose_layout(device, task, stored, build.surface, build.body.bay, show)

    how, trials, searched, index = "", None, None, 0
    if earlier is not None and earlier.searched is not None:
        searched = earlier.searched
        task = task.with_decoder(earlier.decoder)
        index, layout = take_offer(device, task, searched)
        how, (chosen, trials) = searched.record.continued, choose(task, [layout])
    elif earlier is not None:
        start = task.with_decoder(earlier.decoder)
        how, continued = _continue(device, start, earlier, subrange(report, 0.0, 0.8), observer)
        if continued is not None:
            chosen, trials = choose(start, [continued])
            task, trials = (task, None) if chosen.problem else (start, trials)
    if trials is None:
        how = ""
        runner = SearchRunner(device, task.design, observer, map_tasks)
        task, first = _search_decoders(device, task, subrange(report, 0.0, 0.4), runner)
        found = search_alternatives(device, task, first, subrange(report, 0.4, 0.8), runner)
        chosen, trials = choose(task, found)
        if chosen.problem and is_searched(device):
            more = search_more(device, task, len(first.sensors), report, runner)
            if more:
                again, further = choose(task, more)
                if not again.problem:
                    chosen, trials = again, (*further, *trials)
    stiffness: tuple[str, ...] = ()
    if device.cord.trace is not None and chosen.relief is not None:
        others = [t for t in trials if t is not chosen]
        task, chosen, effect = _stiffen(device, build, task, chosen, report, choose)
        trials, stiffness, build.forces = (chosen, *others), (effect.describe(),), effect.forces
    else:
        build.forces = pose_forces(device, build.quadratic_mesh, build.plain_fields)
    save_forces(build.folder, build.forces)
    record = _layout_record(device, build, task, chosen, trials)
    if repairs and not device.propose:
        record = replace(record, drawn=_paths(drawn), repaired=tuple(repairs))
    warnings = (*record.warnings, *stiffness, *describe_repairs(device, repairs, how))
    if device.parts not in (None, chosen.parts):
        warnings += (
            f"no layout with {device.parts} parts was reached. Remove [design] parts or"
            " --parts, or increase [design] searches",
        )
    build.layout = replace(record, continued=how, warnings=warnings)
    if searched is not None:
        build.layout = keep_search(build.layout, searched, index)
    build.prediction = PredictionRecord(
        task.points,
        task.names,
        chosen.scored.signals,
        chosen.scored.errors,
        chosen.scored.decoder.to_json(),
    )
    paths = (tuple(CordPath.of(s) for s in t.layout.sensors) for t in trials)
    build.weighed = WeighedCords(tuple(paths)) if searched is None else searched.paths
    save_layout(build.folder, build.layout, build.prediction)
    save_weighed(build.folder, build.weighed)
    if chosen.part_set is None or chosen.relief is None:
        return None
    return Winner(chosen.relief.device, chosen.relief.notes, chosen.part_set, task)


def _stiffen(
    device: Device,
    build: Build,
    task: DesignTask,
    chosen: Trial,
    report: Report,
    choose: Callable[[DesignTask, Sequence[OptimizedLayout]], tuple[Trial, tuple[Trial, ...]]],
) -> tuple[DesignTask, Trial, Stiffening]:
    """Predict a layout of printed traces with their stiffness, and improve it where that matters.

    Returns:
        The task with the poses of the stiffened body, the layout made on trial, and the effect.
    """
    assert chosen.relief is not None
    effect = stiffen(device, build, task, tuple(chosen.relief.channels), report)
    layouts = [chosen.layout]
    if effect.signals > MIN_SIGNAL_CHANGE and any(s.free for s in chosen.layout.sensors):
        with suppress(LayoutError):
            layouts.append(improve_layout(effect.task.design, chosen.layout.sensors, report))
    best, _ = choose(effect.task, layouts)
    if best.relief is not None and best.layout.sensors is not chosen.layout.sensors:
        effect = stiffen(device, build, task, tuple(best.relief.channels), report)
        best, _ = choose(effect.task, [best.layout])
    return effect.task, best, effect


def _continue(
    device: Device,
    task: DesignTask,
    earlier: EarlierLayout,
    report: Report,
    observer: SearchObserver,
) -> tuple[str, OptimizedLayout | None]:
    """Keep an earlier layout, or improve it.

    Returns:
        How the layout came about, as in `LayoutRecord.continued`, and the layout; None if it breaks
        limits that descents from it cannot keep.

    Raises:
        LayoutError: The drawn cords break a limit.
    """
    require_drawing(task.design, device.sensors)
    drawn = None if device.propose else device.sensors
    if earlier.is_current:
        kept = evaluate_unchanged(task.design, earlier.starts[0])
        if kept is not None:
            report(1.0, "the layout still keeps all limits")
            return "kept", replace(kept, initial=drawn or kept.initial)
    found = []
    for k, start in enumerate(earlier.starts):
        show = subrange(report, k / len(earlier.starts), (k + 1) / len(earlier.starts))
        with suppress(LayoutError):
            found.append(
                improve_layout(
                    task.design,
                    start,
                    show,
                    planes=device.planes,
                    watch=observer.kept,
                    follow=observer.passed,
                )
            )
    if not found:
        return "", None
    best = min(found, key=lambda layout: (layout.slivers, layout.rmse))
    return "improved", replace(best, initial=drawn or best.initial)


def require_feasible_layout(device: Device, layout: LayoutRecord) -> None:
    """Raise FabricationError if none of the layouts that were made on trial can be made.

    A single layout of a printed device is left to the stage of the parts, whose error has a place.

    Args:
        device: The device.
        layout: The layout of its build.
    """
    is_cast = device.fabrication.kind == "cast"
    layouts = layout.weighed
    if any(t.problem is None for t in layouts) or len(layouts) < (1 if is_cast else 2):
        return
    numbers: dict[str, list[str]] = {}
    for number, trial in enumerate(layouts, start=1):
        numbers.setdefault(str(trial.problem), []).append(str(number))
    reasons = " ".join(f"({', '.join(which)}) {reason}" for reason, which in numbers.items())
    searches = device.searches or default_searches(len(layout.sensors))
    count = f"none of {len(layouts)} layouts" if len(layouts) > 1 else "the layout"
    raise FabricationError(
        f"{count} can{'' if len(layouts) > 1 else 'not'} be {'cast' if is_cast else 'printed'}:"
        f" {reasons}",
        code="no-feasible-layout",
        where=device.source / "device.toml",
        action=f"Raise [design] searches ({searches}) or sensors ({len(layout.sensors)})"
        if is_searched(device)
        else f"Move the {device.cord.noun}s in [[sensors]]",
        problems=[t.problem for t in layouts],
        searches=searches,
        sensors=len(layout.sensors),
    )


def _search_decoders(
    device: Device, task: DesignTask, report: Report, runner: SearchRunner
) -> tuple[DesignTask, OptimizedLayout]:
    """Return the task with the decoder that does best on unseen states, and its layout."""
    kinds = candidate_decoders(device, task)
    # Decoders with the same features have the same design objective.
    designs = {FEATURES[kind]: kind for kind in reversed(kinds)}
    searches = [Search(kind, 0, device.planes) for kind in kinds if kind in designs.values()]
    layouts = dict(zip((s.decoder for s in searches), runner.run(searches, report), strict=True))
    found: dict[str, tuple[float, OptimizedLayout]] = {}
    for kind in kinds:
        layout = layouts[designs[FEATURES[kind]]]
        if isinstance(layout, LayoutError):
            raise layout
        decoded = task.with_decoder(kind)
        scored = predict(decoded, assumed_cords(decoded, layout.sensors))
        found[kind] = (scored.prediction.unseen, layout)
    best = min(found, key=lambda k: found[k][0])
    return task.with_decoder(best), found[best][1]


def _layout_record(
    device: Device, build: Build, task: DesignTask, chosen: Trial, trials: Sequence[Trial]
) -> LayoutRecord:
    layout, final, limits = chosen.layout, chosen.scored, task.design.limits
    # What decoders that were not designed for would make of the chosen cords.
    decoded = {kind: task.with_decoder(kind) for kind in DECODERS}
    predicted = {kind: predict(t, final.cords).prediction for kind, t in decoded.items()}
    initial = score_paths(device, task, build.surface, layout.initial, build.body.bay)
    check = verify(layout.sensors, build.surface, limits)
    if check.violations:
        raise LayoutError(
            f"the optimized layout violates a limit: {check.violations[0]}",
            code=check.violations[0].code,
        )
    sensors = _cord_records(device, layout.sensors, check, task, final)
    smallest_noise_free = min(p.unseen_noise_free for p in predicted.values())
    risks = find_risks(task.design, layout.sensors)
    uncalibrated = warn_uncalibrated_strains(device, sensors)
    return LayoutRecord(
        device=device.name,
        mesh=build.mesh_record.hash,
        limits=LimitsRecord(limits.wall, limits.min_radius, limits.clearance),
        response=device.cord.measured,
        sensors=sensors,
        min_clearance=check.min_clearance,
        warnings=(
            *map(str, risks),
            *map(str, check_cord_count(task.everything, final.prediction, smallest_noise_free)),
            *uncalibrated,
        ),
        weighed=tuple(_weighed_record(t, t is chosen) for t in trials),
        prediction=final.prediction,
        unseen={kind: p.unseen for kind, p in predicted.items()},
        cross_validated={k: left_out_error(t, final.cords) for k, t in decoded.items()},
        band=predict_built_devices(device, task, final.cords, session_shares(device, task.weights)),
        initial=initial.prediction,
        drawn=_paths(layout.initial),
        proposed=device.propose > 0,
        starts=tuple(layout.starts),
        seed=device.seed,
        warned_cords={**{str(r): r.where for r in risks if r.where}, **uncalibrated},
    )


def _paths(sensors: Sequence[Sensor]) -> tuple[Float, ...]:
    return tuple(sample_path(s) for s in sensors)


def _weighed_record(trial: Trial, chosen: bool) -> WeighedRecord:
    return WeighedRecord(
        designed=trial.designed,
        built=None if trial.problem else trial.built,
        planes=trial.planes,
        slanted=trial.slanted,
        parts=trial.parts,
        smallest=trial.smallest,
        free_ends=trial.free_ends,
        warnings=trial.warnings,
        problem=trial.problem,
        chosen=chosen,
        pieces=() if trial.part_set is None else pieces_of_parts(trial.part_set),
    )


def as_stored(found: OptimizedLayout) -> OptimizedLayout:
    """Return the layout with the planes' frames exactly as `layout.json` gives them back.

    The last digits decide cuts along faces that touch, so parts made on trial must equal those that
    are made from the file later.
    """
    cords = [replace(s, plane=CordPath.of(s).sensor().plane) for s in found.sensors]
    return replace(found, sensors=tuple(cords))


def _cord_records(
    device: Device,
    sensors: Sequence[Sensor],
    check: LayoutCheck,
    task: DesignTask,
    scored: ScoredLayout,
) -> tuple[CordRecord, ...]:
    records = []
    rows = zip(sensors, check.cords, scored.cords, scored.prediction.noise, strict=True)
    for channel, (sensor, measured, built, noise) in enumerate(rows):
        lowest, highest = _strain_range(built, task.everything.deform(built.path))
        records.append(
            CordRecord(
                **vars(CordPath.of(sensor)),
                channel=channel,
                points=sample_path(sensor),
                length=measured.length,
                min_radius=min(measured.min_radius, 1e6),
                min_wall=measured.min_wall,
                inlets=measured.inlets,
                cord_diameter=device.cord.diameter,
                peak_strain=highest,
                least_strain=lowest,
                stretch=built.path,
                series=built.series,
                prestretch=built.prestretch,
                noise=noise,
            )
        )
    return tuple(records)


def _strain_range(cord: BuiltCord, deformed: Float) -> tuple[float, float]:
    """Return the lowest and highest strain of a cord over rest and all states (s, p, 3).

    Of a bonded cord they are those of any segment; of a held one the mean along it, below zero
    where it would be slack.
    """
    if cord.prestretch is None:
        lowest, highest = segment_strain_range(cord.path, deformed)
        return min(lowest, 0.0), max(highest, 0.0)
    mean = (1 + cord.prestretch) * (1 + np.append(0.0, mean_strain(cord.path, deformed))) - 1
    return float(mean.min()), float(mean.max())


def warn_uncalibrated_strains(device: Device, sensors: Sequence[CordRecord]) -> dict[str, str]:
    """Return a warning for each cord that leaves the strains its response was measured in.

    Returns:
        The name of the cord by the warning.
    """
    low, high = device.cord.response.strain_range
    return {
        f"{device.cord.noun} {s.name!r}: strains of {s.least_strain:.1%} to {s.peak_strain:.1%} are"
        f" outside the calibrated range of {low:.1%} to {high:.1%}, beyond which the response is"
        " continued along its tangent. Calibrate on tighter jigs, or trust the prediction"
        " less.": s.name
        for s in sensors
        if s.least_strain < low or s.peak_strain > high
    }
