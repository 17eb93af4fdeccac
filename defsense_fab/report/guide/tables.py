"""Build the tables of the assembly guide: what to print, cut and buy, and what was measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...core.arrays import Float
from ...geometry.parts.records import Check
from ...store.manifest import END_NAMES, Manifest, WireRecord
from ..wiring.connections import PartKind, Wire, Wiring, color_code

_MAX_DECIMALS = 9


@dataclass(frozen=True)
class GuideTable:
    """A table of texts.

    Attributes:
        title: Title of the table.
        header: Headings of its columns.
        rows: Rows with as many texts as the header.
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def guide_tables(manifest: Manifest) -> tuple[GuideTable, ...]:
    """Return the tables of what to print, to cut and to buy.

    The headings are also the columns of the CSV files in an exported device: do not change them.
    """
    sensors = _list_traces(manifest) if manifest.traces else _cut_list(manifest)
    return _print_table(manifest), sensors, _bill_of_materials(manifest)


def _print_table(manifest: Manifest) -> GuideTable:
    plate_files = {name: p.file for p in manifest.plates for name in p.parts}
    bounds_on_plate = {name: box for p in manifest.plates for name, box in p.parts.items()}
    # Moulds are printed in place of the parts that are cast in them.
    pieces = [piece for mould in manifest.moulds for piece in mould.pieces]
    if manifest.traces:
        return _list_solids(manifest, plate_files, bounds_on_plate)
    solids = [(q.name, bounds_on_plate[q.name], q.volume) for q in pieces]
    solids = solids or [(p.name, p.bbox, p.volume) for p in manifest.parts]
    rows = [
        (
            name,
            str(manifest.copies if not pieces else 1),
            " x ".join(f"{high - low:.1f}" for low, high in zip(*box, strict=True)),
            f"{volume / 1000:.1f}",
            plate_files[name],
        )
        for name, box, volume in solids
    ]
    rows += [
        (
            p.name,
            str(p.count * manifest.copies),
            f"{p.diameter:g} x {p.length:.1f}",
            "",
            plate_files[f"{p.name}_1"],
        )
        for p in manifest.pins
    ]
    return GuideTable("Print", ("part", "copies", "size", "cm3", "on plate"), tuple(rows))


def _list_solids(
    manifest: Manifest, files: Mapping[str, str], bounds: Mapping[str, Float]
) -> GuideTable:
    """Return the table of a body and its traces, which one file holds."""
    volumes = {t.name: t.volume for t in manifest.traces}
    rows = tuple(
        (
            name,
            str(manifest.copies),
            " x ".join(f"{size:.1f}" for size in np.ptp(box, axis=0)),
            f"{volumes.get(name, manifest.parts[0].volume) / 1000:.2f}",
            files[name],
        )
        for name, box in bounds.items()
    )
    return GuideTable("Print", ("part", "copies", "size", "cm3", "on plate"), rows)


def _list_traces(manifest: Manifest) -> GuideTable:
    rows = tuple(
        (
            t.name,
            f"{t.length:.0f}",
            f"{t.resistance:.0f}",
            f"{t.range[0]:.0f} to {t.range[1]:.0f}",
            f"{t.reference_resistor:g}",
            " / ".join("({:.1f}, {:.1f}, {:.1f})".format(*p) for p in t.pads),
        )
        for t in manifest.traces
    )
    header = ("trace", "length", "ohm at rest", "ohm in use", "reference, ohm", "pads at")
    return GuideTable("Traces", header, rows)


def _cut_list(manifest: Manifest) -> GuideTable:
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
            " / ".join(_describe_exit(e.wire) for e in c.ends),
        )
        for c in manifest.cords
    ]
    header = (
        "cord",
        "cut to",
        "between joints",
        "trimmed off",
        "stretched by",
        "joints at start / end",
        "ohm loose / installed",
        "ohm in use",
        "reference, ohm",
        "wires leave",
    )
    return GuideTable("Cut list", header, tuple(rows))


def _describe_exit(wire: WireRecord) -> str:
    """Describe where a wire leaves the body, with its length inside the body in mm."""
    length = f" ({wire.length:.0f})" if wire.length else ""
    return str(wire.leaves) + length


def _bill_of_materials(manifest: Manifest) -> GuideTable:
    rows = tuple((b.item, b.amount, b.use) for b in manifest.bill)
    return GuideTable("Bill of materials", ("item", "amount", "for"), rows)


def wiring_tables(wiring: Wiring) -> tuple[GuideTable, GuideTable]:
    """Return the tables of the connections of each cord, and of all other connections."""
    rows = tuple(
        (
            channel.cord,
            "ground rail",
            "junction of resistor and pin",
            f"{channel.resistor:g} ohm ({', '.join(color_code(channel.resistor))})",
            wiring.describe(wiring.input_of(channel)),
        )
        for channel in wiring.channels
    )
    header = (wiring.noun, *(f"{end} to" for end in END_NAMES), "resistor to supply rail", "pin")
    others = tuple(
        (wiring.describe(c.start), wiring.describe(c.end))
        for c in wiring.connections
        if PartKind.RESISTOR not in (c.start.kind, c.end.kind) and c.wire is not Wire.CORD
    )
    return (
        GuideTable("Wires of each " + wiring.noun, header, rows),
        GuideTable("Other wires", ("from", "to"), others),
    )


def guide_checks(manifest: Manifest) -> GuideTable:
    """Return the table of the measurements of the finished parts, with their limits."""
    rows = tuple(
        (c.name, *_format_comparison(c), "yes" if c.holds else "no", c.at) for c in manifest.checks
    )
    header = ("quantity", "measured", "limit", "passed", "place")
    return GuideTable("Checked before writing", header, rows)


def _format_comparison(check: Check) -> tuple[str, str]:
    """Format value and limit with enough decimals to show which is greater.

    Shares are formatted as percentages.
    """
    factor, unit = (1.0, f" {check.unit}") if check.unit else (100.0, " %")
    value, limit = factor * check.value, factor * check.limit
    decimals = 2
    while decimals < _MAX_DECIMALS and (
        np.sign(round(value, decimals) - round(limit, decimals)) != np.sign(value - limit)
    ):
        decimals += 1
    comparison = "at least" if check.at_least else "at most"
    texts = (f"{n:.{decimals}f}" for n in (value, limit))
    measured, bound = (s.rstrip("0").rstrip(".") if float(s) else "0" for s in texts)
    return measured + unit, f"{comparison} {bound}{unit}"
