"""Compare the limits that a layout breaks with those of a changed layout."""

from __future__ import annotations

from ..problem.problem import Limits
from .verification import LayoutCheck, LimitViolation

_TOLERANCE_MM = 2e-3  # by which a broken limit may change
#: Violations whose measured quantity is larger where they are worse.
_LARGER_IS_WORSE = frozenset({"path-leaves-body", "end-far-from-surface", "kept-region-cut"})
_OUTSIDE = frozenset({"path-leaves-body", "end-far-from-surface"})
#: Violations that are not looked for in a cord that does not end at the surface.
_HIDDEN_BY_OUTSIDE = _OUTSIDE | {"wall-too-thin", "exit-not-allowed", "channel-length-not-allowed"}
_HIDDEN_BY_ANY = frozenset({"channel-length-not-allowed"})


def worsened_limits(
    before: LayoutCheck, after: LayoutCheck, limits: Limits
) -> list[LimitViolation]:
    """Return the violations of a changed layout that are new, or worse than before.

    Args:
        before: The layout as it was.
        after: The changed layout.
        limits: The limits.
    """
    old = {(v.code, v.cords): _excess(v, limits) for v in before.violations}
    codes: dict[str, set[str]] = {}
    for violation in before.violations:
        for name in violation.cords:
            codes.setdefault(name, set()).add(violation.code)
    worse = []
    for v in after.violations:
        known = old.get((v.code, v.cords))
        if known is not None:
            is_worse = _excess(v, limits) > known + _TOLERANCE_MM
        else:
            had = codes.get(v.cords[0], set())
            was_hidden = (v.code in _HIDDEN_BY_OUTSIDE and had & _OUTSIDE) or (
                v.code in _HIDDEN_BY_ANY and had
            )
            is_worse = not was_hidden
        if is_worse:
            worse.append(v)
    return worse


def _excess(violation: LimitViolation, limits: Limits) -> float:
    """Return a number (mm) that grows as a violation gets worse."""
    if violation.code == "channel-length-not-allowed":
        return max(limits.shortest - violation.value, violation.value - limits.longest)
    if violation.code == "exit-not-allowed":
        return 0.0  # its value is the length of the inlet
    return violation.value if violation.code in _LARGER_IS_WORSE else -violation.value
