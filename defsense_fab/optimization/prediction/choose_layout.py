"""Choose the layout to build among those that a search found: one that is simple to make.

Layouts whose errors differ by a few per cent differ more in effort than in accuracy, and the best
may be impossible to make. Their errors are those of the cords as built in, on unseen states; the
channels are enough to know them. The parts of layouts that may be chosen are made on trial, as
triangle meshes, in some seconds. For cast devices the openings of all moulds are checked, and the
moulds of the chosen layout are made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, TypeVar

from ...core.arrays import Float
from ...core.curve import Plane, distinct_planes
from ...core.device.device import Device
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ...core.progress import Report, subrange
from ...geometry.kernels.cutting_tools import Prism
from ...geometry.moulds.moulds import check_openings, make_moulds
from ...geometry.parts.records import PartSet
from ..refinement.refine import OptimizedLayout
from ..search.plane_directions import count_slanted, face_directions
from .as_built import (
    StrainRelief,
    assumed_cords,
    decide_strain_relief,
    fabricate,
    mould_rules,
    score_channels,
)
from .assembly_effects import find_overstretched_cords
from .design_task import DesignTask
from .predict import ScoredLayout, predict

SIMILAR_ERROR_RATIO = 1.05  # to the best error, within which layouts count as equally accurate
#: Ratio to the best error, within which a layout with fewer parts is preferred.
FEWER_PARTS_ERROR_RATIO = 1.25
#: Ratio to the best error, beyond which a layout is not offered.
MAX_OFFERED_ERROR_RATIO = 10.0


class TriedLayout(Protocol):
    """A layout that may have been made on trial; see `WeighedRecord`."""

    @property
    def built(self) -> float | None: ...
    @property
    def parts(self) -> int | None: ...
    @property
    def free_ends(self) -> int: ...
    @property
    def slanted(self) -> int: ...
    @property
    def warnings(self) -> tuple[str, ...]: ...
    @property
    def problem(self) -> str | None: ...


W = TypeVar("W", bound=TriedLayout)


def assembly_effort(one: TriedLayout) -> tuple[bool, int, int, int]:
    """Return a sort key of the effort to make a layout; smaller is simpler.

    It compares whether there are warnings, then parts and ends without pockets, then slanted
    planes, then the number of warnings.
    """
    pieces = (one.parts or 0) + one.free_ends
    return bool(one.warnings), pieces, one.slanted, len(one.warnings)


def prefer_layout(trials: Sequence[W], prefer: str, parts: int | None = None) -> W | None:
    """Choose among layouts that were made on trial.

    Args:
        trials: The layouts; those whose parts were not made are ignored.
        prefer: `"accuracy"` for the smallest error as built, else the fewest parts of the layouts
            with an error within 25 % of the smallest, and of these the simplest about as good.
        parts: Number of parts of the layout; None for any.

    Returns:
        The chosen layout, or None if no layout can be made.
    """
    feasible = [t for t in _feasible(trials) if parts in (None, t.parts)]
    if not feasible:
        return None
    if prefer == "accuracy":
        return min(feasible, key=_built)
    best = min(_built(t) for t in feasible)
    good = [t for t in feasible if _built(t) <= FEWER_PARTS_ERROR_RATIO * best]
    fewest = min(t.parts or 0 for t in good)
    return _simplest([t for t in good if t.parts == fewest])


def offered_layouts(trials: Sequence[W], prefer: str) -> list[W]:
    """Return the layouts to choose from: for each number of parts the preferred one.

    Args:
        trials: The layouts; those whose parts were not made are ignored.
        prefer: As for `prefer_layout`.

    Returns:
        The layouts, the one with the fewest parts first, without those whose errors are useless.
    """
    feasible = _feasible(trials)
    best = min(map(_built, feasible), default=0.0)
    useful = [t for t in feasible if _built(t) <= MAX_OFFERED_ERROR_RATIO * best]
    counts = sorted({t.parts or 0 for t in useful})
    offers = (prefer_layout(useful, prefer, count) for count in counts)
    return [offer for offer in offers if offer is not None]


def _feasible(trials: Sequence[W]) -> list[W]:
    """Return the layouts whose parts were made."""
    return [t for t in trials if t.problem is None and t.parts is not None]


def _simplest(trials: Sequence[W]) -> W:
    """Return the simplest of the layouts that are about as good as the best of them."""
    best = min(_built(t) for t in trials)
    similar = [t for t in trials if _built(t) <= SIMILAR_ERROR_RATIO * best]
    return min(similar, key=lambda t: (*assembly_effort(t), _built(t)))


def _built(one: TriedLayout) -> float:
    return float("inf") if one.built is None else one.built


_MAX_TRIALS = 6  # layouts on trial before those with fewer planes
_SAME_ERROR_RTOL = 1e-4  # by which the errors of equal layouts may differ


@dataclass(frozen=True)
class Trial:
    """A layout whose channels, and perhaps parts, were made on trial.

    Attributes:
        layout: The layout.
        designed: RMSE (mm) on unseen states as designed.
        scored: The prediction as built.
        slanted: Number of directions of planes that are not those of flat faces.
        parts: Number of parts, None if they were not made.
        smallest: Volume of the smallest part, mm^3.
        free_ends: Number of cord ends without a pocket that holds them.
        warnings: Notes about the parts and their assembly.
        problem: Reason why it cannot be made.
        failure: The error with this reason, and its cord and place.
        relief: The strain relief, with the channels; None if they cannot be made.
        part_set: The parts.
    """

    layout: OptimizedLayout
    designed: float
    scored: ScoredLayout
    slanted: int
    parts: int | None = None
    smallest: float | None = None
    free_ends: int = 0
    warnings: tuple[str, ...] = ()
    problem: str | None = None
    failure: FabricationError | None = field(default=None, repr=False, compare=False)
    relief: StrainRelief | None = field(default=None, repr=False, compare=False)
    part_set: PartSet | None = field(default=None, repr=False, compare=False)

    @property
    def built(self) -> float:
        """RMSE (mm) on unseen states as built."""
        return self.scored.prediction.unseen

    @property
    def planes(self) -> int:
        """Number of planes that the body is cut along."""
        return _count_planes(self.layout)


def drop_duplicates(layouts: Sequence[OptimizedLayout]) -> list[OptimizedLayout]:
    """Drop equal layouts and sort by the error on fitted states; slivers come last."""
    out: list[OptimizedLayout] = []
    for layout in sorted(layouts, key=lambda f: (f.slivers, f.rmse)):
        if not any(
            abs(layout.rmse - other.rmse) <= _SAME_ERROR_RTOL * other.rmse
            and _count_planes(layout) == _count_planes(other)
            for other in out
        ):
            out.append(layout)
    return out


def _count_planes(layout: OptimizedLayout) -> int:
    return len(distinct_planes(_planes(layout)))


def _count_slanted(layout: OptimizedLayout, directions: Float) -> int:
    return count_slanted(_planes(layout), directions)


def _planes(layout: OptimizedLayout) -> list[Plane]:
    return [s.plane for s in layout.sensors if s.curve.is_planar]


def choose_layout(
    device: Device,
    task: DesignTask,
    layouts: Sequence[OptimizedLayout],
    surface: Surface,
    bay: Prism | None,
    report: Report,
) -> tuple[Trial, tuple[Trial, ...]]:
    """Choose the layout to build.

    Among the layouts that can be made and have an error within 25 % of the best one, one with the
    fewest parts is chosen, or the most accurate with `[design] prefer = "accuracy"`. Parts are made
    in the order of the errors as built, until no other layout can be chosen. Clearly worse layouts
    are considered only if none of these can be made, or none has the number of `[design] parts`.
    Layouts with fewer planes or fewer slanted ones are always among the trials, to show what they
    cost; the parts of those with fewer planes are made, so that they can be taken.

    Args:
        device: The device.
        task: Its design task.
        layouts: The layouts from the search.
        surface: The body's surface.
        bay: Connector bay, if any.
        report: Called with the share of the work done and a description.

    Returns:
        The trial to build, and all trials, the best by design first. If no layout can be made, the
        best by design is returned with its problem.
    """
    expected = [(f, _score_design(task, f).prediction.unseen) for f in drop_duplicates(layouts)]
    ranked = sorted(expected, key=lambda e: (e[0].slivers, e[1]))
    slivers, bound = ranked[0][0].slivers, FEWER_PARTS_ERROR_RATIO * ranked[0][1]
    candidates = [e for e in ranked if e[1] <= bound and e[0].slivers == slivers][:_MAX_TRIALS]
    directions = face_directions(surface)

    def outline(layout: OptimizedLayout, error: float) -> Trial:
        return outline_trial(device, task, layout, error, surface, bay, directions)

    def is_simpler(layout: OptimizedLayout) -> bool:
        """Return whether it has fewer planes, or fewer slanted ones, than all possible trials."""
        possible = [t for t in trials if not t.problem]
        return _count_planes(layout) < min(t.planes for t in possible) or _count_slanted(
            layout, directions
        ) < min(t.slanted for t in possible)

    trials = [outline(*candidate) for candidate in candidates]
    untried = ranked[len(candidates) :]
    cast = device.fabrication.kind == "cast"
    share = 0.7 if cast else 1.0
    ratio = 1.0 if device.prefer == "accuracy" else FEWER_PARTS_ERROR_RATIO
    parts = device.parts
    while True:
        best = prefer_layout(trials, device.prefer, device.parts)
        if best is None and parts is None:
            best = prefer_layout(trials, device.prefer)
        least = min((t.built for t in trials if t.parts is not None), default=float("inf"))
        unmade = [t for t in trials if t.problem is None and t.parts is None]
        unmade = [t for t in unmade if not any(_surpasses(m, t) for m in _feasible(trials))]
        following = min((t for t in unmade if t.built <= ratio * least), key=_built, default=None)
        if following is None and best is not None:
            following = _best_with_fewer_planes(trials)
        elif following is None and parts is not None:
            following = _best_with_parts(trials, parts)
        if following is not None:
            number = 1 + sum(t.parts is not None or t.problem is not None for t in trials)
            report(share * (number - 1) / len(trials), f"making layout {number} on trial")
            made_trial = make_on_trial(task, following, surface, bay)
            trials = [made_trial if t is following else t for t in trials]
        elif best is None and untried:
            trials.append(outline(*untried.pop(0)))
        elif best is None and parts is not None:
            parts = None  # no layout has so many
        elif best is not None and any(is_simpler(e[0]) for e in untried):
            simpler = next(k for k, e in enumerate(untried) if is_simpler(e[0]))
            trials.append(outline(*untried.pop(simpler)))
        elif best is None or not cast:
            return best or trials[0], tuple(trials)
        elif (error := casting_error(device, best, subrange(report, share, 1.0))) is None:
            return best, tuple(trials)
        else:
            failed = _fail(best, error)
            trials = [failed if t is best else t for t in trials]


def _best_with_fewer_planes(trials: Sequence[Trial]) -> Trial | None:
    """Return the best layout with fewer planes than all whose parts were made, to offer it, too."""
    fewest = min(t.planes for t in _feasible(trials))
    fewer = (t for t in trials if t.parts is None and not t.problem and t.planes < fewest)
    return min(fewer, key=_built, default=None)


def _best_with_parts(trials: Sequence[Trial], parts: int) -> Trial | None:
    """Return the best layout that was not made and may have so many parts.

    Each plane cuts the body into at least one more part.
    """
    unmade = (t for t in trials if t.parts is None and not t.problem)
    return min((t for t in unmade if t.planes < parts), key=_built, default=None)


def _surpasses(made: Trial, unmade: Trial) -> bool:
    """Return whether a layout is clearly better than one that has at least as many parts.

    Each plane cuts the body into at least one more part.
    """
    is_better = SIMILAR_ERROR_RATIO * made.built < unmade.built
    return is_better and made.parts is not None and made.parts <= unmade.planes + 1


def casting_error(device: Device, trial: Trial, report: Report) -> FabricationError | None:
    """Return why the parts of a layout cannot be cast, or None, by making their moulds."""
    assert trial.part_set is not None
    try:
        make_moulds(trial.part_set, mould_rules(device), report)
    except FabricationError as error:
        return error
    return None


def _fail(trial: Trial, error: FabricationError) -> Trial:
    """Return the trial of a layout that cannot be made after all."""
    return Trial(
        trial.layout,
        trial.designed,
        trial.scored,
        trial.slanted,
        problem=str(error),
        failure=error,
    )


def _score_design(task: DesignTask, layout: OptimizedLayout) -> ScoredLayout:
    return predict(task, assumed_cords(task, layout.sensors))


def outline_trial(
    device: Device,
    task: DesignTask,
    layout: OptimizedLayout,
    designed: float,
    surface: Surface,
    bay: Prism | None,
    directions: Float,
) -> Trial:
    """Return the trial of a layout without its parts.

    Args:
        device: The device.
        task: Its design task.
        layout: The layout.
        designed: Its expected error as designed, mm.
        surface: The body's surface.
        bay: Connector bay, if any.
        directions: Directions (k, 3) of the body's flat faces.
    """
    slants = _count_slanted(layout, directions)
    try:
        relief = decide_strain_relief(device, task, surface, layout.sensors, bay)
    except FabricationError as error:
        scored = _score_design(task, layout)
        return _fail(Trial(layout, designed, scored, slants), error)
    free = sum(not e.pocket for c in relief.channels for e in c.ends)
    return Trial(
        layout,
        designed,
        score_channels(task, relief.channels),
        slants,
        free_ends=free if device.fabrication.pockets else 0,
        relief=relief,
    )


def make_on_trial(task: DesignTask, trial: Trial, surface: Surface, bay: Prism | None) -> Trial:
    """Return a trial with its parts, or with the problem that prevents them.

    Args:
        task: The design task of the device.
        trial: The trial without its parts; if it has a problem, it is returned.
        surface: The body's surface.
        bay: Connector bay, if any.
    """
    if trial.relief is None:
        return trial
    device, channels = trial.relief.device, trial.relief.channels
    try:
        part_set = fabricate(
            device, surface, trial.layout.sensors, lambda *_: None, None, bay, channels
        )
        if device.fabrication.kind == "cast":
            check_openings(part_set)
    except FabricationError as error:
        return _fail(trial, error)
    built = score_channels(task, part_set.channels)
    free = sum(not e.pocket for c in part_set.channels for e in c.ends)
    return replace(
        trial,
        scored=built,
        parts=len(part_set.parts),
        smallest=min(p.volume for p in part_set.parts),
        free_ends=free if device.fabrication.pockets else 0,
        warnings=(
            *part_set.warnings,
            *map(str, find_overstretched_cords(device, part_set, built.cords)),
        ),
        part_set=part_set,
    )
