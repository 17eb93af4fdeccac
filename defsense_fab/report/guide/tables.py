"""The tables of the assembly guide: what to print, to cut and to buy, and what was measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...geometry.parts.records import Check
from ...store.manifest import Manifest, WireRecord

_MOST = 9  # decimals


@dataclass(frozen=True)
class GuideTable:
    """Rows of texts under a header."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def guide_tables(manifest: Manifest) -> tuple[GuideTable, ...]:
    """What to print, to cut and to buy."""
    return _parts(manifest), _cuts(manifest), _bill(manifest)


def _parts(manifest: Manifest) -> GuideTable:
    where = {n: p.file for p in manifest.plates for n in p.parts}
    lying = {n: bounds for p in manifest.plates for n, bounds in p.parts.items()}
    pieces = [q for m in manifest.moulds for q in m.pieces]  # of cast parts, in place of them
    rows = [
        (
            name,
            str(manifest.copies if not pieces else 1),
            " x ".join(f"{b - a:.1f}" for a, b in zip(*box, strict=True)),
            f"{volume / 1000:.1f}",
            where[name],
        )
        for name, box, volume in (
            [(q.name, lying[q.name], q.volume) for q in pieces]
            or [(p.name, p.bbox, p.volume) for p in manifest.parts]
        )
    ]
    rows += [
        (p.name, str(p.count * manifest.copies), f"{p.diameter:g} x {p.length:.1f}", "",
         where[f"{p.name}_1"])
        for p in manifest.pins
    ]  # fmt: skip
    return GuideTable("Print", ("part", "copies", "size", "cm3", "on plate"), tuple(rows))


def _cuts(manifest: Manifest) -> GuideTable:
    rows = [
        (
            c.sensor,
            f"{c.cut_length:.0f}",
            f"{c.unstretched:.1f}",
            f"{c.cut_length - c.unstretched:.0f}",
            "bonded" if c.prestretch is None else f"{c.prestretch:.0%}",
            " / ".join(
                ("in pocket" if e.joint == "pocket" else f"{e.lead:.0f} free")
                + ("" if e.after is None else ", crimped last")
                for e in c.ends
            ),
            f"{c.resistance_before:.0f} / {c.resistance:.0f}",
            f"{c.range[0]:.0f} to {c.range[1]:.0f}",
            f"{c.reference_resistor:g}",
            " / ".join(_leaves(e.wire) for e in c.ends),
        )
        for c in manifest.cords
    ]
    header = (
        "cord", "cut to", "between joints", "trimmed off", "stretched by", "joints at start / end",
        "ohm loose / laid", "ohm in use", "reference, ohm", "wires leave",
    )  # fmt: skip
    return GuideTable("Cut list", header, tuple(rows))


def _leaves(wire: WireRecord) -> str:
    """Where a wire leaves the body, and after how many mm in it."""
    inside = f" ({wire.length:.0f})" if wire.length else ""
    return str(wire.leaves) + inside


def _bill(manifest: Manifest) -> GuideTable:
    rows = tuple((b.item, b.amount, b.use) for b in manifest.bill)
    return GuideTable("Bill of materials", ("item", "amount", "for"), rows)


def guide_checks(manifest: Manifest) -> GuideTable:
    """What was measured of the finished parts, beside the limit that it was compared with."""
    rows = tuple((c.name, *_compared(c), "yes" if c.holds else "no", c.at) for c in manifest.checks)
    header = ("what", "measured", "must be", "holds", "near")
    return GuideTable("Checked before writing", header, rows)


def _compared(check: Check) -> tuple[str, str]:
    """Value and limit with as many decimals as show which is greater; shares in per cent."""
    factor, unit = (1.0, f" {check.unit}") if check.unit else (100.0, " %")
    value, limit = factor * check.value, factor * check.limit
    decimals = 2
    while decimals < _MOST and (
        np.sign(round(value, decimals) - round(limit, decimals)) != np.sign(value - limit)
    ):
        decimals += 1
    which = "at least" if check.at_least else "at most"
    shown = (f"{n:.{decimals}f}" for n in (value, limit))
    measured, least = (s.rstrip("0").rstrip(".") if float(s) else "0" for s in shown)
    return measured + unit, f"{which} {least}{unit}"
