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
    old = _by_limit(before, limits)
    codes: dict[str, set[str]] = {}
    for violation in before.violations:
        for name in violation.cords:
            codes.setdefault(name, set()).add(violation.code)
    worse = []
    for key, violations in _by_limit(after, limits).items():
        known = [_excess(v, limits) for v in old.get(key, ())]
        had = codes.get(key[1][0], set())
        was_hidden = (key[0] in _HIDDEN_BY_OUTSIDE and had & _OUTSIDE) or (
            key[0] in _HIDDEN_BY_ANY and had
        )
        for k, v in enumerate(violations):
            if k < len(known):
                is_worse = _excess(v, limits) > known[k] + _TOLERANCE_MM
            else:
                is_worse = not was_hidden
            if is_worse:
                worse.append(v)
    return worse


def _by_limit(
    check: LayoutCheck, limits: Limits
) -> dict[tuple[str, tuple[str, ...]], list[LimitViolation]]:
    """Return the violations by code and cords, the worst first: a cord may have several of one."""
    groups: dict[tuple[str, tuple[str, ...]], list[LimitViolation]] = {}
    for violation in check.violations:
        groups.setdefault((violation.code, violation.cords), []).append(violation)
    for group in groups.values():
        group.sort(key=lambda v: _excess(v, limits), reverse=True)
    return groups


def _excess(violation: LimitViolation, limits: Limits) -> float:
    """Return a number (mm) that grows as a violation gets worse."""
    if violation.code == "channel-length-not-allowed":
        return max(limits.shortest - violation.value, violation.value - limits.longest)
    if violation.code == "exit-not-allowed":
        return 0.0  # its value is the length of the inlet
    return violation.value if violation.code in _LARGER_IS_WORSE else -violation.value
