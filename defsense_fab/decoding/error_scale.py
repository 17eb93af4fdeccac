"""The scale of errors: how large an error is, compared with how far the surface moves."""

from __future__ import annotations

from typing import Literal

Grade = Literal["very good", "usable", "poor"]

#: Shares of the largest movement below which an error is very good, and usable. The scale is a
#: choice of this project, not a standard.
VERY_GOOD_SHARE = 0.02
USABLE_SHARE = 0.05
#: Explanation of the scale for users.
SCALE = (
    f"An error below {100 * VERY_GOOD_SHARE:g} % of the largest movement is called"
    f" very good, below {100 * USABLE_SHARE:g} % usable, and poor otherwise. This scale is our own"
    " choice."
)


def grade_error(error: float, travel: float) -> Grade:
    """Return the grade of an error.

    Args:
        error: Root mean square error of the surface or of markers, mm.
        travel: Largest movement of the same points, mm.
    """
    if error < VERY_GOOD_SHARE * travel:
        return "very good"
    return "usable" if error < USABLE_SHARE * travel else "poor"


def describe_error(
    error: float, travel: float, size: float | None = None, what: str = "it moves"
) -> str:
    """Return an error with its grade, as in "0.49 mm, 0.94 % of the 52 mm it moves: very good".

    Args:
        error: Root mean square error of the surface or of markers, mm.
        travel: Largest movement of the same points, mm.
        size: Longest side of the body, mm; None to leave it out.
        what: What moves.
    """
    if travel <= 0:
        return describe_share(error, travel)
    body = "" if size is None else f" (the body is {_short(size)} mm long)"
    return f"{describe_share(error, travel, what)}: {grade_error(error, travel)}{body}"


def describe_share(error: float, travel: float, what: str = "it moves") -> str:
    """Return an error with its share of the movement, as in "0.49 mm, 0.94 % of the 52 mm it
    moves".

    Args:
        error: Root mean square error of the surface or of markers, mm.
        travel: Largest movement of the same points, mm.
        what: What moves.
    """
    if travel <= 0:
        return f"{error:.2f} mm, and nothing moves"
    return f"{error:.2f} mm, {_short(100 * error / travel)} % of the {_short(travel)} mm {what}"


def _short(value: float) -> str:
    """Return a number with two significant digits, or without decimals from 10 on."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"
