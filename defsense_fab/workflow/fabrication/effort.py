"""State what a device takes before it is made: printing, material, cord, assembly and cost.

Report, guide, terminal and studio show these numbers. The time of assembly sums the actions of the
guide with the times in `data/assembly.csv`; the cost sums the bill of materials with the prices in
`[prices]` of `device.toml`, and states what has none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...core.device.device import Device
from ...core.device.glues import find_glue
from ...core.device.prices import Prices
from ...core.progress import describe_duration
from ...core.storage.package_data import read_rows
from ...report.guide.actions import Action, ActionKind
from ...report.guide.plan import last_joint_while_wet, plan_actions
from ...report.guide.tables import GuideTable
from ...store.manifest import BillItem, CutCord, Manifest
from .print_time import pieces_on_plate, print_hours

_TIMES, _GLUES = "assembly.csv", "glues.csv"


@dataclass(frozen=True)
class PlateEffort:
    """What a plate takes.

    Attributes:
        file: File of the plate.
        pieces: Number of pieces.
        hours: Time to print it, h; None without an estimate.
        mass: Mass of the solid pieces, g; None if their material is not that of the device.
    """

    file: str
    pieces: int
    hours: float | None
    mass: float | None


@dataclass(frozen=True)
class AssemblyTime:
    """Working time of the assembly of one device.

    Attributes:
        minutes: Time in which somebody works, min.
        cures: Number of times that glue has to set before the work continues.
        cure_hours: Time of these waits one after another, h.
        casting_hours: Time in which the silicone of all parts cures, h; 0 if it is not cast, or
            the time is not known.
    """

    minutes: float
    cures: int
    cure_hours: float
    casting_hours: float


@dataclass(frozen=True)
class Cost:
    """The cost by the prices that the user gives.

    Attributes:
        amount: Sum of all items with a price.
        currency: Its currency.
        without_price: Items of the bill that have none, by name.
    """

    amount: float
    currency: str
    without_price: tuple[str, ...]


@dataclass(frozen=True)
class Effort:
    """What all copies of a device take.

    Attributes:
        copies: Number of devices.
        parts: Number of parts of one device.
        joints: Number of joints of one device that are glued.
        pieces: Number of pieces on all plates.
        cords: Number of cords or traces of one device.
        plates: The plates.
        mass: Mass of the body's material, g.
        cord: Length of cord to cut, mm; 0 for traces.
        spare: Length of cord to keep as a spare, mm.
        assembly: Time to assemble all copies one after another.
        cost: Cost by the given prices; None without any.
    """

    copies: int
    parts: int
    joints: int
    pieces: int
    cords: int
    plates: tuple[PlateEffort, ...]
    mass: float
    cord: float
    spare: float
    assembly: AssemblyTime
    cost: Cost | None

    @property
    def print_hours(self) -> float | None:
        """Time to print all plates, h; None without an estimate."""
        hours = [plate.hours for plate in self.plates if plate.hours is not None]
        return sum(hours) if len(hours) == len(self.plates) else None

    def describe(self) -> str:
        """Return the effort as one line."""
        hours, time = self.print_hours, self.assembly
        count = f"{self.copies} devices of " if self.copies > 1 else ""
        items = [f"{count}{describe_count(self.parts, 'part')}"]
        if hours is not None:
            items.append(f"{describe_duration(3600 * hours)} of printing")
        items.append(f"{self.mass:.0f} g of material")
        if self.cord:
            items.append(f"{self.cord:.0f} mm of cord and {self.spare:.0f} mm spare")
        if self.joints:
            items.append(f"{describe_count(self.copies * self.joints, 'joint')} to glue")
        items.append(f"{describe_duration(60 * time.minutes)} of assembly")
        if time.cures:
            items.append(f"{describe_count(time.cures, 'wait')} of {_each(time)} for glue")
        if time.casting_hours:
            items.append(f"{describe_duration(3600 * time.casting_hours)} in which silicone cures")
        if self.cost is not None:
            items.append(f"{self.cost.amount:.2f} {self.cost.currency}")
        return ", ".join(items)


def describe_count(count: int, noun: str) -> str:
    """Return a count with its noun, as in "1 part" and "3 parts"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def effort_table(device: Device, manifest: Manifest) -> GuideTable:
    """Return the table of what a device takes, with the basis of each figure."""
    effort, glue = find_effort(device, manifest), find_glue(device)
    rows = [*_print_rows(device, effort), *_material_rows(device, effort)]
    time = effort.assembly
    rows.append(
        (
            "assembly",
            describe_duration(60 * time.minutes),
            (
                f"{describe_count(effort.copies * effort.joints, 'joint')} to glue; "
                if effort.joints
                else ""
            )
            + f"the time of each action is assumed (data/{_TIMES})",
        )
    )
    if time.cures:
        rows.append(
            (
                "waiting",
                describe_duration(3600 * time.cure_hours),
                f"{describe_count(time.cures, 'wait')} of {_each(time)} until the glue holds; it"
                f" has its full strength after {describe_duration(3600 * glue.cure_hours)}"
                f" ({glue.kind}, data/{_GLUES})",
            )
        )
    if time.casting_hours:
        cure = "the cure of the silicone, one device after another in the same moulds"
        rows.append(("casting", describe_duration(3600 * time.casting_hours), cure))
    return GuideTable("What it takes", ("item", "about", "basis"), (*rows, _cost_row(effort)))


def _print_rows(device: Device, effort: Effort) -> list[tuple[str, str, str]]:
    hours, f = effort.print_hours, device.fabrication
    plates = "; ".join(
        f"{p.file}: {describe_count(p.pieces, 'piece')}"
        + ("" if p.hours is None else f", {describe_duration(3600 * p.hours)}")
        + ("" if p.mass is None else f", {p.mass:.0f} g")
        for p in effort.plates
    )
    if hours is None or f.rate is None:
        return [("printing", "no estimate", plates)]
    text = f"{plates}. Solid, at {f.rate:g} mm3/s ([fabrication] rate)"
    if device.cord.trace is not None:
        text += ", without the changes of filament"
    return [("printing", describe_duration(3600 * hours), text)]


def _material_rows(device: Device, effort: Effort) -> list[tuple[str, str, str]]:
    count = describe_count(effort.parts, "part")
    of_copies = f" for each of {effort.copies} devices" if effort.copies > 1 else ""
    basis = f"{count}{of_copies}, {describe_count(effort.pieces, 'piece')} on all plates"
    rows = [(device.material.name, f"{effort.mass:.0f} g", basis)]
    if effort.cord:
        pieces = describe_count(effort.copies * effort.cords, "piece")
        text = f"{pieces}; buy {effort.spare:.0f} mm more as a spare"
        rows.append((f"cord {device.cord.name}", f"{effort.cord:.0f} mm", text))
    return rows


def _cost_row(effort: Effort) -> tuple[str, str, str]:
    cost = effort.cost
    if cost is None:
        return "cost", "not known", "give the prices that you pay in [prices] of device.toml"
    missing = f", without {', '.join(cost.without_price)}" if cost.without_price else ""
    return "cost", f"{cost.amount:.2f} {cost.currency}", f"by [prices] of device.toml{missing}"


def _each(time: AssemblyTime) -> str:
    return describe_duration(3600 * time.cure_hours / time.cures)


def find_effort(device: Device, manifest: Manifest) -> Effort:
    """Return what a device with its parts takes.

    Args:
        device: The device.
        manifest: The manifest of its parts.
    """
    copies, bill = manifest.copies, manifest.bill
    has_cords = not manifest.traces
    return Effort(
        copies=copies,
        parts=len(manifest.parts),
        joints=len(manifest.assembly),
        pieces=sum(len(plate.parts) for plate in manifest.plates),
        cords=len(manifest.cords),
        plates=_plates(device, manifest),
        mass=1000 * sum(b.quantity for b in bill if b.good in ("filament", "silicone")),
        cord=copies * sum(c.cut_length for c in manifest.cords) if has_cords else 0.0,
        spare=copies * spare_length(manifest.cords) if has_cords else 0.0,
        assembly=assembly_time(manifest, find_glue(device).press_hours),
        cost=find_cost(device.prices, bill),
    )


def spare_length(cords: Sequence[CutCord]) -> float:
    """Return the length of cord to keep as a spare for one device, mm.

    It is the longest piece of the cut list, which can replace any other.
    """
    return max((c.cut_length for c in cords), default=0.0)


def _plates(device: Device, manifest: Manifest) -> tuple[PlateEffort, ...]:
    plates = []
    for plate in manifest.plates:
        pieces = pieces_on_plate(manifest, plate)
        mass = sum(p.volume for p in pieces) / 1000 * device.material.density
        plates.append(
            PlateEffort(
                plate.file,
                len(pieces),
                print_hours(device.fabrication, pieces),
                None if manifest.moulds else mass,
            )
        )
    return tuple(plates)


def find_cost(prices: Prices, bill: tuple[BillItem, ...]) -> Cost | None:
    """Return the cost of a bill of materials; None if no price is given."""
    if not prices.goods:
        return None
    priced = [b for b in bill if b.good in prices.goods]
    return Cost(
        sum(b.quantity * prices.goods[b.good] for b in priced),
        prices.currency,
        tuple(b.item for b in bill if b.good not in prices.goods),
    )


def assembly_time(manifest: Manifest, press_hours: float) -> AssemblyTime:
    """Return the time to assemble all copies, by the actions of the guide.

    Plates and their pieces are those of all copies; everything else is done for each copy. Glue of
    all copies sets at the same time, and so does that of joints that are closed one after another
    while it is wet; copies are cast in the same moulds, one after another.

    Args:
        manifest: The manifest of the device's parts.
        press_hours: Time for which a glued joint is pressed before the work continues, h.
    """
    times = read_rows(_TIMES).values()
    minutes, cures, cure_hours = 0.0, 0, 0.0
    for action in plan_actions(manifest):
        counts = _counts(action, manifest)
        for row in times:
            if row["action"] != action.kind:
                continue
            copies = 1 if row["each"] in ("plate", "piece") else manifest.copies
            minutes += copies * counts[row["each"]] * float(row["minutes"] or 0)
            if row["waits"] == "glue" and not _sets_later(action, manifest):
                cures += 1
                cure_hours += press_hours
    casting = manifest.casting
    casting_hours = manifest.copies * (casting.cure or 0.0) if casting else 0.0
    return AssemblyTime(minutes, cures, cure_hours, casting_hours)


def _sets_later(action: Action, manifest: Manifest) -> bool:
    """Return whether a joint sets together with a later one, which is closed while it is wet."""
    j = action.joint if action.kind is ActionKind.SET else None
    return j is not None and last_joint_while_wet(manifest, j) is not None


def _counts(action: Action, manifest: Manifest) -> Mapping[str, float]:
    """Return how often each unit of `data/assembly.csv` occurs in an action."""
    cord = next((c for c in manifest.cords if c.sensor == action.cord), None)
    length = 0.0
    if cord is not None:
        here = [s for s in cord.stretches if s.joint == action.joint]
        length = sum(s.stop - s.start for s in here) if cord.stretches else cord.channel_length
    return {
        "action": 1,
        "plate": len(manifest.plates),
        "piece": sum(len(plate.parts) for plate in manifest.plates),
        "mould": len(manifest.moulds),
        "pin": sum(pin.count for pin in manifest.pins),
        "joint": len(manifest.assembly),
        "wire": 2 * len(manifest.cords),
        "cord": len(manifest.cords),
        "100 mm": length / 100,
    }
