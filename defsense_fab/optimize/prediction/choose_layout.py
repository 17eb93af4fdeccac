"""Of the layouts that a search found, the one to build: it can be made, and it is simple to make.

Layouts within some per cent of the best differ more in what they ask of the maker than in what they
sense, and perhaps the best cannot be made at all. So each is made on trial (with triangles, which
takes some seconds), and its error is that on unseen states, of the cords as they are built in. Of
cast ones the openings of all moulds are looked for, and the moulds of the one to build are made.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

from ...core.arrays import Float
from ...core.curve import distinct_planes
from ...core.device.device import Device
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ...geometry.kernels.cutting_tools import Prism
from ...geometry.moulds.moulds import check_openings, make_moulds
from ...geometry.parts.records import PartSet
from ..refinement.refine import OptimizedLayout, report_part
from ..search.plane_directions import count_slanted, face_directions
from .as_built import as_made, assumed_cords, fabricate, mould_rules, with_relief
from .design_task import DesignTask
from .open_joints import overstretched
from .predict import Scored, predict
from .preference import preferred

#: PartSet on trial: those that are this much worse by design at most, so many of them at most.
_HOPEFUL, _MOST = 1.15, 6
#: Relative difference of errors at which two layouts are one.
_SAME = 1e-4

Report = Callable[[float, str], None]


@dataclass(frozen=True)
class Trial:
    """A layout made on trial: RMSE (mm) on unseen states by design, and what it is predicted to
    sense as built; how many directions of planes are no flat face's; its parts, the smallest one's
    volume (mm^3), ends of cords without the pocket that holds them, and what is to be said of the
    parts and of putting them together; or the `problem` for which it cannot be made, and no
    parts."""

    found: OptimizedLayout
    designed: float
    scored: Scored
    slanted: int
    parts: int | None = None
    smallest: float | None = None
    free_ends: int = 0
    warnings: tuple[str, ...] = ()
    problem: str | None = None
    made: PartSet | None = field(default=None, repr=False, compare=False)
    as_built: Device | None = field(default=None, repr=False, compare=False)
    relief_notes: tuple[str, ...] = ()

    @property
    def built(self) -> float:
        """RMSE (mm) on unseen states as built."""
        return self.scored.prediction.unseen

    @property
    def planes(self) -> int:
        """How many planes the body is cut along."""
        return len(distinct_planes([s.plane for s in self.found.sensors]))


def different(found: Sequence[OptimizedLayout]) -> list[OptimizedLayout]:
    """Without those that have come to the same layout, the best on fitted states first. Slivers
    come last."""
    out: list[OptimizedLayout] = []
    for one in sorted(found, key=lambda f: (f.slivers, f.rmse)):
        if not any(
            abs(one.rmse - o.rmse) <= _SAME * o.rmse and _planes(one) == _planes(o) for o in out
        ):
            out.append(one)
    return out


def _planes(found: OptimizedLayout) -> int:
    return len(distinct_planes([s.plane for s in found.sensors]))


def _slanted(found: OptimizedLayout, directions: Float) -> int:
    return count_slanted([s.plane for s in found.sensors], directions)


def choose_layout(
    device: Device,
    task: DesignTask,
    found: Sequence[OptimizedLayout],
    surface: Surface,
    bay: Prism | None,
    report: Report,
) -> tuple[Trial, tuple[Trial, ...]]:
    """The trial to build and all trials, the best by design first, without slivers if it can be.

    Of those as good as the best that can be made, by their errors as built, the simplest; with
    `[design] prefer = "accuracy"` the best. Layouts that are worse are tried only where none of
    these can be made, and fewer planes or fewer slanted ones always, to show what they cost. Where
    none can be made, the best by design is returned with its problem.
    """
    expected = [(f, _designed(task, f).prediction.unseen) for f in different(found)]
    ranked = sorted(expected, key=lambda e: (e[0].slivers, e[1]))
    least, bound = ranked[0][0].slivers, _HOPEFUL * ranked[0][1]
    hopeful = [e for e in ranked if e[1] <= bound and e[0].slivers == least][:_MOST]
    directions = face_directions(surface)

    def tried(one: OptimizedLayout, error: float) -> Trial:
        return make_on_trial(device, task, one, error, surface, bay, directions)

    trials = []
    cast = device.fabrication.kind == "cast"
    share = 0.7 if cast else 1.0
    for k, (one, error) in enumerate(hopeful):
        report(share * k / len(hopeful), f"making layout {k + 1} of {len(hopeful)} on trial")
        trials.append(tried(one, error))
    left = []
    for one, error in ranked[len(hopeful) :]:
        made = [t for t in trials if not t.problem]
        if (
            not made
            or _planes(one) < min(t.planes for t in made)
            or _slanted(one, directions) < min(t.slanted for t in made)
        ):
            trials.append(tried(one, error))
        else:
            left.append((one, error))
    while True:
        best = preferred(trials, device.prefer)
        if best is None and left:
            trials.append(tried(*left.pop(0)))
        elif best is None or not cast:
            return best or trials[0], tuple(trials)
        elif (
            problem := _uncastable(device, best, partial(report_part, report, share, 1.0))
        ) is None:
            return best, tuple(trials)
        else:
            refused = _refused(best, problem)
            trials = [refused if t is best else t for t in trials]


def _uncastable(device: Device, trial: Trial, report: Report) -> str | None:
    """Why the parts of a layout cannot be cast, by making their moulds."""
    assert trial.made is not None
    try:
        make_moulds(trial.made, mould_rules(device), report)
    except FabricationError as error:
        return str(error)
    return None


def _refused(trial: Trial, problem: str) -> Trial:
    """What cannot be made after all."""
    return Trial(trial.found, trial.designed, trial.scored, trial.slanted, problem=problem)


def _designed(task: DesignTask, found: OptimizedLayout) -> Scored:
    return predict(task, assumed_cords(task, found.sensors))


def make_on_trial(
    device: Device,
    task: DesignTask,
    found: OptimizedLayout,
    designed: float,
    surface: Surface,
    bay: Prism | None,
    directions: Float,
) -> Trial:
    """The layout made, of which `designed` mm were expected, on a body whose flat faces have the
    `directions` (k, 3)."""
    slants = _slanted(found, directions)
    try:
        device, relief_notes = with_relief(device, task, surface, found.sensors, bay)
        made = fabricate(device, surface, found.sensors, lambda *_: None, None, bay)
        if device.fabrication.kind == "cast":
            check_openings(made, mould_rules(device))
    except FabricationError as error:
        return Trial(found, designed, _designed(task, found), slants, problem=str(error))
    built = as_made(task, made.channels)
    smallest = min(p.volume for p in made.parts)
    free = sum(not e.pocket for c in made.channels for e in c.ends)
    return Trial(
        found,
        designed,
        built,
        slants,
        len(made.parts),
        smallest,
        free if device.fabrication.pockets else 0,
        (*made.warnings, *overstretched(device, made, built.cords)),
        made=made,
        as_built=device,
        relief_notes=tuple(relief_notes),
    )
