"""Write moulds as files and records, and plan how much silicone they take."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...core.arrays import Float, format_point
from ...core.device.device import Device
from ...core.device.materials import Silicone, find_silicone
from ...core.mesh import Surface
from ...geometry.kernels import triangle_kernel
from ...geometry.moulds.moulds import take_whole_piece
from ...geometry.moulds.records import Mould
from ...geometry.printing.export import write_stl
from ...geometry.printing.print_bed import lay_flat
from ...optimization.prediction.as_built import linear_shrinkage
from ...store.manifest import BillItem, Casting, MouldPieceRecord, MouldRecord

#: Share of silicone that is mixed in addition to the cavities' volume: it stays in the cup, in
#: funnels and in vents.
WASTE = 0.1
FOLDER = "moulds"
_MIN_REPORTED_STRAIN = 0.005


def lying(moulds: Sequence[Mould]) -> dict[str, Surface]:
    """Return every piece of the moulds in print orientation, closed in single precision."""
    surfaces = {}
    for piece in (p for m in moulds for p in m.pieces):
        solid = triangle_kernel.to_manifold(lay_flat(piece.surface, piece.down), piece.name)
        surfaces[piece.name] = triangle_kernel.to_printable_surface(
            take_whole_piece(solid, piece.name), piece.name
        )
    return surfaces


def write_moulds(
    moulds: Sequence[Mould], flat: dict[str, Surface], out: Path, print_folder: str
) -> tuple[MouldRecord, ...]:
    """Write the pieces of moulds, around their part and in print orientation.

    Args:
        moulds: The moulds.
        flat: Pieces in print orientation, by name.
        out: The folder of the parts.
        print_folder: Name of the folder for pieces in print orientation.

    Returns:
        Records of the moulds.
    """
    (out / FOLDER).mkdir()
    records = []
    for mould in moulds:
        for piece in mould.pieces:
            write_stl(piece.surface, out / FOLDER / f"{piece.name}.stl")
            write_stl(flat[piece.name], out / print_folder / f"{piece.name}.stl")
        records.append(
            MouldRecord(
                part=mould.part,
                pieces=tuple(
                    MouldPieceRecord(
                        p.name,
                        f"{FOLDER}/{p.name}.stl",
                        f"{print_folder}/{p.name}.stl",
                        p.opens,
                        p.surface.volume,
                    )
                    for p in mould.pieces
                ),
                up=mould.up,
                pour=mould.pour,
                vents=mould.vents,
                cavity=mould.cavity,
                block=mould.block,
                strain=mould.strain,
                strained_at=mould.at,
            )
        )
    return tuple(records)


def casting(device: Device, moulds: Sequence[Mould]) -> Casting:
    """Return how much silicone all copies take, and the steps of casting.

    Args:
        device: The device.
        moulds: Moulds of its parts.

    Returns:
        The record for the manifest: volumes in mm3, masses in g.
    """
    silicone = find_silicone(device.material.name)
    copies = device.fabrication.copies
    volume = sum(m.cavity for m in moulds) * copies
    mixed = volume * (1 + WASTE) / 1000
    grams = mixed * device.material.density
    a, b = silicone.ratio if silicone else (1.0, 1.0)
    masses = (grams * a / (a + b), grams * b / (a + b))
    steps = _write_steps(device, moulds, silicone, mixed, masses)
    return Casting(
        silicone=device.material.name,
        shrinkage=linear_shrinkage(device),
        volume=volume,
        mixed=mixed * 1000,
        mass_a=masses[0],
        mass_b=masses[1],
        pot_life=silicone.pot_life if silicone else None,
        cure=silicone.cure if silicone else None,
        steps=tuple(steps),
    )


def _write_steps(
    device: Device,
    moulds: Sequence[Mould],
    silicone: Silicone | None,
    mixed: float,
    masses: tuple[float, float],
) -> list[str]:
    """Write the steps of casting; `mixed` (cm3) and `masses` (g) are for all copies."""
    steps = [
        "Brush a thin film of a release agent for silicone onto every face that silicone or another"
        " piece touches, and let it dry. Silicone does not stick to PLA or PETG, but the film fills"
        " the layer lines and makes the part easy to remove.",
        "Close each mould: first the cups, then the lids, the lid with the funnel last. The keys"
        " must enter their sockets. Screw the pieces together (M3, 8 to 10 mm, driven into the"
        " plastic), or hold them with clamps or rubber bands.",
        _write_mixing_step(device, silicone, mixed, masses),
    ]
    pour = (
        "Place each mould level with the funnel up. Pour a thin stream into the funnel until"
        " silicone fills every vent. Tap the mould, wait some minutes, and pour again."
    )
    if silicone and silicone.pot_life:
        pour += f" The mixture can be poured for {silicone.pot_life:g} min at 23 C."
    steps.append(pour)
    cure = "Let it cure for the time on the can."
    if silicone and silicone.cure:
        cure = f"Let it cure for {silicone.cure:g} h at 23 C."
    orders = "; ".join(
        f"{m.part}: " + ", ".join(p.name.removeprefix(f"mould-{m.part}-") for p in m.pieces)
        for m in moulds
    )
    steps += [
        f"{cure} Then remove the pieces in this order, each straight along its direction:"
        f" {orders}.",
        "Cut off the stubs of funnel and vents flush with the face, and the thin skins at the ends"
        " of the grooves and along the seams.",
    ]
    return steps


def _write_mixing_step(
    device: Device, silicone: Silicone | None, mixed: float, masses: tuple[float, float]
) -> str:
    """Write the step that mixes the silicone of one device; amounts are for all copies."""
    copies = device.fabrication.copies
    mixed = mixed / copies
    masses = (masses[0] / copies, masses[1] / copies)
    repetition = ""
    if copies > 1:
        # A mixture can be poured for less time than casting several devices takes.
        repetition = f" Mix again for each of the {copies} devices, and cast one after the other."
    if silicone is None:
        return (
            f"Mix {mixed:.0f} cm3 in the ratio on the can, 10 % more than the moulds hold."
            f" This is {sum(masses):.0f} g at a density of {device.material.density:g} g/cm3."
            f"{repetition}"
        )
    ratio = f"{silicone.ratio[0]:g} : {silicone.ratio[1]:g} by {silicone.by}"
    return (
        f"Mix {masses[0]:.0f} g of part A with {masses[1]:.0f} g of part B ({ratio}). This is"
        f" {mixed:.0f} cm3, 10 % more than the moulds hold.{repetition} Stir slowly, scrape the"
        " cup's wall, and remove the air in a vacuum if you can."
    )


def notes(device: Device, moulds: Sequence[Mould]) -> dict[str, Float | None]:
    """Return what the user should know before printing, each with the point (3,) mm concerned."""
    out: dict[str, Float | None] = {
        f"{m.part} is stretched by about {m.strain:.0%} near {format_point(m.at)} when it is"
        " removed from its mould, because its skin is undercut there; pull it off slowly": m.at
        for m in moulds
        if m.strain > _MIN_REPORTED_STRAIN and m.at is not None
    }
    out |= {c.note: c.point for m in moulds for c in m.checks if c.note}
    if find_silicone(device.material.name) is None:
        text = (
            f"{device.material.name!r} is not in silicones.csv, so a shrinkage of"
            f" {linear_shrinkage(device):.1%} and a ratio of 1 : 1 are assumed; set [fabrication]"
            " shrinkage = 0.002, or the value of its data sheet"
        )
        out[text] = None
    return out


def bill_items(device: Device, moulds: Sequence[Mould], cast: Casting) -> list[BillItem]:
    """Return the bill's items for silicone, moulds, release agent and screws."""
    plastic = sum(p.surface.volume for m in moulds for p in m.pieces) / 1000
    count = sum(len(m.pieces) for m in moulds)
    return [
        BillItem(
            f"{device.material.name}, cast",
            f"{cast.mixed / 1000:.0f} cm3",
            f"{len(moulds)} parts; {cast.mass_a:.0f} g of A and {cast.mass_b:.0f} g of B, 10 % more"
            " than the moulds hold",
            "silicone",
            (cast.mass_a + cast.mass_b) / 1000,
        ),
        BillItem(
            "rigid plastic for moulds, printed",
            f"{plastic:.0f} cm3",
            f"{count} pieces of {len(moulds)} moulds, as if printed solid",
        ),
        BillItem("release agent for silicone", "a spray can", "on all faces of the moulds"),
        BillItem("screw M3, 8 to 10 mm", "4 to 8 a mould", "or clamps, or rubber bands"),
    ]
