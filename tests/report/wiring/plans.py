"""Plans of wirings for tests, and their nets: sets of terminals that are connected."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from dataclasses import replace

from defsense_fab.report.wiring.connections import PartKind, plan_wiring
from tests.report.guide.blocks import blocks

#: A board, a converter, and the numbers of cords that they can read.
READOUTS = [
    ("nano", "arduino", (1, 3, 8)),
    ("uno", "arduino", (6,)),
    ("esp32", "esp32", (6,)),
    ("pico", "pico", (1, 3)),
    ("nano", "ads1115", (1, 3, 5, 8, 16)),
    ("esp32", "ads1115", (1, 3, 8, 16)),
    ("pico", "ads1115", (3, 16)),
]
CASES = [(board, converter, n) for board, converter, counts in READOUTS for n in counts]
RESISTORS = (470.0, 1000.0, 2200.0, 15000.0)
NAMES = ("left", "right <a> & b", 'a cord: with a "long" name, which no drawing has room for')


def manifest_of(cords):
    """Return a device and a manifest with a number of cords."""
    some = blocks(0, 1)
    cut = some.manifest.cords[0]
    names = [*NAMES, *(f"cord-{n}" for n in range(len(NAMES), cords))][:cords]
    rows = [
        replace(
            cut,
            sensor=name,
            resistance=900.0 + 37 * n,
            range=(800.0 + 37 * n, 1400.0 + 37 * n),
            reference_resistor=RESISTORS[n % len(RESISTORS)],
        )
        for n, name in enumerate(names)
    ]
    return some.device, replace(some.manifest, cords=tuple(rows))


def plan(cords, board="nano", converter=None):
    """Return the wiring of a device with a number of cords."""
    return plan_wiring(*manifest_of(cords), board, converter)


def join(pairs: Iterable[tuple[Hashable, Hashable]]) -> set[frozenset[Hashable]]:
    """Return the sets of items that are connected by pairs."""
    sets: dict[Hashable, set[Hashable]] = {}
    for a, b in pairs:
        joined = sets.get(a, {a}) | sets.get(b, {b})
        sets |= dict.fromkeys(joined, joined)
    return {frozenset(s) for s in sets.values()}


def nets(wiring):
    """Return the nets of a plan as sets of (kind, number, pin), without the rails."""
    joined = join((c.start, c.end) for c in wiring.connections)
    rails = (PartKind.GROUND, PartKind.SUPPLY)
    return {
        frozenset((str(t.kind), t.number, t.pin) for t in net if t.kind not in rails)
        for net in joined
    }
