"""The tables of the assembly guide: what to print, to cut and to buy, and what was measured."""

from __future__ import annotations

from dataclasses import dataclass

from ..artifacts.manifest import Manifest, WireRecord


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
            f"{c.slack:.0f}",
            f"{c.unstretched:.1f}",
            "bonded" if c.prestretch is None else f"{c.prestretch:.0%}",
            " / ".join(
                "in pocket" if e.joint == "pocket" else f"{e.lead:.0f} free" for e in c.ends
            ),
            f"{c.resistance_before:.0f} / {c.resistance:.0f}",
            f"{c.range[0]:.0f} to {c.range[1]:.0f}",
            f"{c.reference_resistor:g}",
            " / ".join(_leaves(e.wire) for e in c.ends),
        )
        for c in manifest.cords
    ]
    header = (
        "cord", "cut to", "of it slack", "between joints", "stretched by", "joints at start / end",
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
    """What was measured of the finished parts."""
    rows = tuple(
        (
            c.name,
            f"{c.value:.3g} {c.unit}".strip(),
            f"{c.limit:.3g} {c.unit}".strip(),
            c.at,
        )
        for c in manifest.checks
    )
    return GuideTable("Checked before writing", ("what", "measured", "limit", "near"), rows)
