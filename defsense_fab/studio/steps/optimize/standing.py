"""What is true of the drawn and of the optimized cords, in one sentence."""

from __future__ import annotations

from dataclasses import dataclass

from ...messages.optimize import OptimizeState


@dataclass(frozen=True)
class Facts:
    """What the sentence follows from.

    Attributes:
        noun: What one sensor is called.
        has_poses: Whether the device has poses.
        has_cords: Whether cords are drawn or will be proposed.
        can_move: Whether a search may move or add cords.
        is_simulated: Whether the simulated poses are those of the device.
        is_searching: Whether a search runs.
        best: Error of the best cords of the search that runs, mm; None before they are found.
        drawn: Error of the drawn cords, mm; None if it cannot be predicted.
        is_drawn_in_parts: Whether this is the error in their parts, not that without the cuts.
        built: Error of the cords of the last build or search, mm; None without one.
        is_built_drawn: Whether the drawn cords are those.
        is_built_moved: Whether a search has moved or added those.
        is_current: Whether nothing has changed since the search.
        best_layout: Name of the layout to use after a search; empty for none.
        best_problem: Why none can be made; empty if one can.
    """

    noun: str
    has_poses: bool
    has_cords: bool
    can_move: bool
    is_simulated: bool
    is_searching: bool
    best: float | None
    drawn: float | None
    built: float | None
    is_built_drawn: bool
    is_built_moved: bool
    is_current: bool
    is_drawn_in_parts: bool = False
    best_layout: str = ""
    best_problem: str = ""


def optimize_state(facts: Facts) -> OptimizeState:
    """Return what is true of the cords, and whether a search can start."""
    standing, text = _standing(facts)
    return OptimizeState(
        standing=standing,  # type: ignore[arg-type]  # one of the names below
        text=text,
        obstacle=_obstacle(facts),
        drawn=facts.drawn,
        is_drawn_in_parts=facts.is_drawn_in_parts,
        built=facts.built,
        is_built_moved=facts.is_built_moved,
        best_layout=facts.best_layout,
        best_problem=facts.best_problem,
    )


def _obstacle(f: Facts) -> str:
    if f.is_searching:
        return "The optimizer is running"
    if not f.has_poses:
        return "Add a pose first"
    if not f.has_cords:
        return f"Add a {f.noun} first"
    if not f.can_move:
        return f"All {f.noun}s are locked: unlock those that the optimizer may move"
    if f.is_current and f.built is not None:
        return "Nothing has changed since the cords were optimized: the result would be the same"
    return ""


def _standing(f: Facts) -> tuple[str, str]:
    cords, drawn = f"{f.noun}s", _drawn(f)
    if f.is_searching:
        start = f"No {cords} within all limits are found yet"
        if f.best is not None:
            start = f"The best {cords} so far have {_mm(f.best)} without the cuts"
        return "searching", f"{start}; the drawn {cords} have {drawn}." if drawn else f"{start}."
    if not f.has_poses:
        return "not-ready", f"Add a pose before you optimize the {cords}."
    if not f.has_cords:
        return "not-ready", f"Draw or propose a {f.noun} before you optimize."
    if f.built is None:
        return _before_a_search(f, cords, drawn)
    built = _mm(f.built)
    if not f.is_simulated:
        return "outdated", (
            f"The body, the material or the poses have changed since the last optimization,"
            f" which reached {built}. Optimize again."
        )
    if f.is_built_drawn:
        if f.is_built_moved or (f.can_move and f.is_current):
            return "optimized", f"The drawn {cords} are the optimized ones: {built} expected."
        return _before_a_search(f, cords, built)
    relation = "are still those it started from" if f.is_current else "are different"
    error = f" and have {drawn}" if drawn else ""
    return (
        "drawn-differ",
        f"The last optimization reached {built}. The drawn {cords} {relation}{error}.",
    )


def _before_a_search(f: Facts, cords: str, error: str) -> tuple[str, str]:
    expected = f" {error} expected." if error else ""
    if not f.can_move:
        return "locked", f"All {cords} are locked: the parts contain them as drawn.{expected}"
    first = f"The {cords} are not optimized.{expected}"
    simulated = "" if expected or f.is_simulated else " The poses are simulated first."
    return "never-searched", first + simulated


def _drawn(f: Facts) -> str:
    if f.drawn is None or f.is_drawn_in_parts:
        return _mm(f.drawn)
    return f"{_mm(f.drawn)} without the cuts"


def _mm(error: float | None) -> str:
    return "" if error is None else f"{error:.2f} mm"
