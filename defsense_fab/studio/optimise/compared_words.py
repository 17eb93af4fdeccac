"""What the page says of layouts that are compared, and the picture of their errors."""

from __future__ import annotations

import html
import math
from collections.abc import Callable, Sequence

from ...optimize.prediction.compare_layouts import ComparedLayout

_BLUE, _ORANGE = "#1f77b4", "#e68c1e"
_WIDTH, _HEIGHT, _LEFT, _BOTTOM, _TOP = 300, 170, 44, 34, 12


def compared_table(layouts: Sequence[ComparedLayout]) -> str:
    """Markdown: a row a layout."""
    lines = ["| layout | mm | 90 % | parts | cords | planes |", "|---|---:|---|---:|---:|---:|"]
    for one in layouts:
        band = f"{one.band[0]:.2f}–{one.band[1]:.2f}" if one.band else "?"
        parts = "cannot be made" if one.problem else "?" if one.parts is None else str(one.parts)
        name = f"**{html.escape(one.name)}**" if one.taken else html.escape(one.name)
        lines.append(
            f"| {name} | {_mm(one.error)} | {'' if one.problem else band} | {parts} |"
            f" {len(one.sensors)} | {one.planes} |"
        )
    lines += ["", "error on unseen states; 90 %: of built devices; bold: taken by the build; parts"
              " ?: not made on trial, as designed"]  # fmt: skip
    if not any(one.name.startswith("study") for one in layouts):
        lines[-1] += "; `defsense study` adds other numbers of cords"
    return "\n".join(lines)


def said_of(one: ComparedLayout) -> str:
    """Markdown: what there is to say of one layout."""
    notes = [one.problem] if one.problem else list(one.warnings)
    return "\n".join(f"- {html.escape(note)}" for note in notes if note)


def scatter(layouts: Sequence[ComparedLayout], chosen: str | None) -> str:
    """HTML: error with its band against the number of parts, and against that of cords."""
    shown = [one for one in layouts if math.isfinite(one.error) and one.error > 0]
    if not shown:
        return ""
    return _picture(shown, chosen, "parts", lambda one: one.parts) + _picture(
        shown, chosen, "cords", lambda one: len(one.sensors)
    )


def _picture(
    layouts: Sequence[ComparedLayout],
    chosen: str | None,
    what: str,
    count: Callable[[ComparedLayout], int | None],
) -> str:
    """On a logarithmic scale; in the colour of the page's text, legible in light and dark."""
    placed = [(n, one) for one in layouts if (n := count(one)) is not None]
    if not placed:
        return ""
    low, high = min(n for n, _ in placed) - 0.5, max(n for n, _ in placed) + 0.5
    errors = [mm for _, one in placed for mm in (one.error, *(one.band or ()))]
    bottom, top = 0.8 * min(errors), 1.25 * max(errors)
    room = _WIDTH - _LEFT - 8, _HEIGHT - _BOTTOM - _TOP

    def x(n: float) -> float:
        return float(_LEFT + room[0] * (n - low) / (high - low))

    def y(mm: float) -> float:
        return float(_TOP + room[1] * math.log(top / mm) / math.log(top / bottom))

    out = [
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" width="100%" font-size="11" fill="currentColor"'
        f' role="img" aria-label="error against {what}">'
    ]
    out += [
        f'<line x1="{_LEFT}" x2="{_WIDTH - 8}" y1="{y(mm):.1f}" y2="{y(mm):.1f}"'
        ' stroke="currentColor" opacity="0.2"/>'
        f'<text x="{_LEFT - 5}" y="{y(mm) + 4:.1f}" text-anchor="end">{mm:g}</text>'
        for mm in _ticks(bottom, top)
    ]
    out += [
        f'<text x="{x(n):.1f}" y="{_HEIGHT - 18}" text-anchor="middle">{n}</text>'
        for n in sorted({n for n, _ in placed})
    ]
    out += [
        f'<text x="{(_LEFT + _WIDTH) / 2}" y="{_HEIGHT - 4}" text-anchor="middle">{what}</text>',
        f'<text x="2" y="{_TOP - 2}">mm</text>',
    ]
    for k, (n, one) in enumerate(placed):
        beside = sum(m == n for m, _ in placed[:k])
        at = x(n) + 9 * (-1) ** beside * ((beside + 1) // 2)
        color, size = (_ORANGE, 6) if one.name == chosen else (_BLUE, 4)
        if one.band:
            low_y, high_y = y(one.band[0]), y(one.band[1])
            out.append(
                f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{low_y:.1f}" y2="{high_y:.1f}"'
                f' stroke="{color}" stroke-width="2"/>'
            )
        told = f"{html.escape(one.name)}: {_mm(one.error)} mm"
        out.append(
            f'<circle cx="{at:.1f}" cy="{y(one.error):.1f}" r="{size}" fill="{color}">'
            f"<title>{told}</title></circle>"
        )
    return "".join([*out, "</svg>"])


def _ticks(bottom: float, top: float) -> list[float]:
    """1, 2 and 5 times powers of ten between the two."""
    powers = range(math.floor(math.log10(bottom)), math.ceil(math.log10(top)) + 1)
    every = [float(f"{k}e{power}") for power in powers for k in (1, 2, 5)]
    return [mm for mm in every if bottom <= mm <= top]


def _mm(error: float) -> str:
    return f"{error:.2f}" if math.isfinite(error) else "?"
