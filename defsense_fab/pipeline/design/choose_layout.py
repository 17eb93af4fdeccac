"""Of the layouts that a search found, the one to build: it can be made, and it is simple to make.

Layouts within some per cent of the best differ more in what they ask of the maker than in what they
sense, and perhaps the best cannot be made at all. So each is made on trial (with triangles, which
takes some seconds), and its error is that of the cords between their ends, as they are built.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ...core.curve import distinct
from ...core.device import Device
from ...core.errors import FabricationError
from ...core.mesh import Surface
from ...geometry.kernels.cutting_tools import Prism
from ...optimize.refinement.refine import Optimised
from .as_built import as_made, fabricate
from .design_task import DesignTask

#: Layouts within this of the best are as good: the band of built devices is wider.
ALIKE = 1.05
#: Made on trial: those that are this much worse by design at most, so many of them at most.
_HOPEFUL, _MOST = 1.15, 6
#: Relative difference of errors at which two layouts are one.
_SAME = 1e-4

Report = Callable[[float, str], None]


@dataclass(frozen=True)
class Trial:
    """A layout made on trial: RMSE (mm) on fitted states by design, and as built; its parts, the
    smallest one's volume (mm^3) and what is to be said of them; or the `problem` for which it
    cannot be made, and no such numbers."""

    found: Optimised
    designed: float
    built: float | None = None
    parts: int | None = None
    smallest: float | None = None
    warnings: tuple[str, ...] = ()
    problem: str | None = None

    @property
    def planes(self) -> int:
        """How many planes the body is cut along."""
        return len(distinct([s.plane for s in self.found.sensors]))

    @property
    def effort(self) -> tuple[bool, int, int]:
        """Less is simpler: whether anything is to be said, parts, how much is to be said."""
        return bool(self.warnings), self.parts or 0, len(self.warnings)


def different(found: Sequence[Optimised]) -> list[Optimised]:
    """The best first, without those that have come to the same layout. Slivers come last."""
    out: list[Optimised] = []
    for one in sorted(found, key=lambda f: (f.slivers, f.rmse)):
        if not any(
            abs(one.rmse - o.rmse) <= _SAME * o.rmse and _planes(one) == _planes(o) for o in out
        ):
            out.append(one)
    return out


def _planes(found: Optimised) -> int:
    return len(distinct([s.plane for s in found.sensors]))


def choose_layout(
    device: Device,
    task: DesignTask,
    found: Sequence[Optimised],
    surface: Surface,
    bay: Prism | None,
    report: Report,
) -> tuple[Trial, tuple[Trial, ...]]:
    """The trial to build and all trials, the best by design first.

    Of those as good as the best that can be made, by their errors as built, the simplest; with
    `[design] prefer = "accuracy"` the best. Layouts that are worse are tried only where none of
    these can be made, and fewer planes always, to show what they cost. Where none can be made, the
    best by design is returned with its problem.
    """
    ranked = different(found)
    bound = _HOPEFUL * ranked[0].rmse
    hopeful = [f for f in ranked if f.rmse <= bound and f.slivers == ranked[0].slivers][:_MOST]
    trials = []
    for k, one in enumerate(hopeful):
        report(k / len(hopeful), f"making layout {k + 1} of {len(hopeful)} on trial")
        trials.append(_make(device, task, one, surface, bay))
    rest = [f for f in ranked if not any(f is h for h in hopeful)]
    fewest = min((t.planes for t in trials), default=0)
    for one in rest:
        if all(t.problem for t in trials) or _planes(one) < fewest:
            trials.append(_make(device, task, one, surface, bay))
            fewest = min(fewest, _planes(one))
    made = [t for t in trials if t.problem is None]
    if not made:
        return trials[0], tuple(trials)
    best = min(_built(t) for t in made)
    if device.prefer == "accuracy":
        chosen = min(made, key=_built)
    else:
        alike = [t for t in made if _built(t) <= ALIKE * best]
        chosen = min(alike, key=lambda t: (*t.effort, _built(t)))
    return chosen, tuple(trials)


def _built(trial: Trial) -> float:
    assert trial.built is not None
    return trial.built


def _make(
    device: Device, task: DesignTask, found: Optimised, surface: Surface, bay: Prism | None
) -> Trial:
    try:
        made = fabricate(device, surface, found.sensors, lambda *_: None, None, bay)
    except FabricationError as error:
        return Trial(found, found.rmse, problem=str(error))
    built = as_made(task, made.channels).prediction.rmse
    smallest = min(p.volume for p in made.parts)
    return Trial(found, found.rmse, built, len(made.parts), smallest, made.warnings)
