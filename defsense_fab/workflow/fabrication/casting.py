"""Moulds as files and records, and how much silicone goes into them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...core.arrays import format_point
from ...core.device.device import Device
from ...core.device.materials import Silicone, find_silicone
from ...core.mesh import Surface
from ...geometry.kernels import triangle_kernel
from ...geometry.moulds.moulds import take_whole_piece
from ...geometry.moulds.records import Mould
from ...geometry.printing.export import write_stl
from ...geometry.printing.print_bed import lay_flat
from ...optimize.prediction.as_built import linear_shrinkage
from ...store.manifest import BillItem, Casting, MouldPieceRecord, MouldRecord

#: What is mixed beyond what the cavities hold: it stays in the cup, in funnels and vents.
WASTE = 0.1
FOLDER = "moulds"
_TOLD = 0.005  # strain


def lying(moulds: Sequence[Mould]) -> dict[str, Surface]:
    """Every piece as it is printed, closed in single precision as it lies."""
    out = {}
    for piece in (p for m in moulds for p in m.pieces):
        solid = triangle_kernel.to_manifold(lay_flat(piece.surface, piece.down), piece.name)
        out[piece.name] = triangle_kernel.to_printable_surface(take_whole_piece(solid, piece.name), piece.name)
    return out


def write_moulds(
    moulds: Sequence[Mould], flat: dict[str, Surface], out: Path, print_folder: str
) -> tuple[MouldRecord, ...]:
    """The pieces where they belong around their part, and as they are printed."""
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
    """How much silicone all copies take, and what to do with it."""
    known = find_silicone(device.material.name)
    copies = device.fabrication.copies
    volume = sum(m.cavity for m in moulds) * copies
    mixed = volume * (1 + WASTE) / 1000
    grams = mixed * device.material.density
    a, b = known.ratio if known else (1.0, 1.0)
    masses = (grams * a / (a + b), grams * b / (a + b))
    steps = _steps(device, moulds, known, mixed, masses)
    return Casting(
        silicone=device.material.name,
        shrinkage=linear_shrinkage(device),
        volume=volume,
        mixed=mixed * 1000,
        mass_a=masses[0],
        mass_b=masses[1],
        pot_life=known.pot_life if known else None,
        cure=known.cure if known else None,
        steps=tuple(steps),
    )


def _steps(
    device: Device,
    moulds: Sequence[Mould],
    known: Silicone | None,
    mixed: float,
    masses: tuple[float, float],
) -> list[str]:
    """What the maker does, in its order."""
    copies = device.fabrication.copies
    times, mixed = "", mixed / copies
    masses = (masses[0] / copies, masses[1] / copies)
    if copies > 1:
        times = f", for each of the {copies} devices anew: they are cast one after the other"
    out = [
        "Brush a thin film of a release agent for silicone onto every face of the moulds that the"
        " silicone or another piece touches, and let it dry; silicone does not stick to PLA or"
        " PETG, but the film fills the layers and the part comes off without force.",
        "Close each mould: cups, then the lids, the one with the funnel last, so that the keys go"
        " into their sockets. Screw them together (M3, 8 to 10 mm, driven into the plastic), or"
        " hold them with clamps or rubber bands.",
    ]
    if known:
        ratio = f"{known.ratio[0]:g} : {known.ratio[1]:g} by {known.by}"
        out.append(
            f"Mix {masses[0]:.0f} g of part A with {masses[1]:.0f} g of part B ({ratio}),"
            f" {mixed:.0f} cm3 in all, 10 % more than the moulds hold{times}; stir slowly, scrape"
            " the cup's wall, and draw the air out in a vacuum if you can."
        )
    else:
        out.append(
            f"Mix {mixed:.0f} cm3 in the ratio on the can, 10 % more than the moulds hold{times};"
            f" {sum(masses):.0f} g by a density of {device.material.density:g} g/cm3."
        )
    pour = known and known.pot_life
    out.append(
        "Stand each mould level with the funnel up. Pour in a thin stream into the funnel until"
        " silicone stands in every vent; knock on the mould, wait some minutes, and pour on."
        + (f" It can be poured for {known.pot_life:g} min at 23 C." if known and pour else "")
    )
    out.append(
        (
            f"Leave it for {known.cure:g} h at 23 C."
            if known and known.cure
            else "Leave it for as long as the can says."
        )
        + " Then take the pieces off in this order, each straight along its own way: "
        + "; ".join(
            f"{m.part}: " + ", ".join(p.name.removeprefix(f"mould-{m.part}-") for p in m.pieces)
            for m in moulds
        )
        + "."
    )
    out.append(
        "Cut the stubs of funnel and vents off flush with the face, and the thin skins at the ends"
        " of the grooves and along the seams."
    )
    out.append(
        "Only silicone holds on cured silicone: where these steps say glue, take a silicone glue"
        " (such as Sil-Poxy) or a little of the same silicone, on faces wiped clean of release"
        " agent with alcohol."
    )
    return out


def notes(device: Device, moulds: Sequence[Mould]) -> list[str]:
    """What should be known before anything is printed."""
    out = [
        f"{m.part} is stretched by about {m.strain:.0%} near {format_point(m.at)} as it is taken out of its"
        " mould: the skin is undercut there; pull it off slowly"
        for m in moulds
        if m.strain > _TOLD and m.at is not None
    ]
    if find_silicone(device.material.name) is None:
        out.append(
            f"{device.material.name!r} is not in silicones.csv: it is taken to shrink by"
            f" {linear_shrinkage(device):.1%} and to mix 1 : 1; write [fabrication] shrinkage = 0.002 or"
            " what its data sheet says"
        )
    return out


def bill_items(device: Device, moulds: Sequence[Mould], cast: Casting) -> list[BillItem]:
    """Silicone, moulds, release agent and screws, in place of what is printed in the material."""
    plastic = sum(p.surface.volume for m in moulds for p in m.pieces) / 1000
    count = sum(len(m.pieces) for m in moulds)
    return [
        BillItem(
            f"{device.material.name}, cast",
            f"{cast.mixed / 1000:.0f} cm3",
            f"{len(moulds)} parts; {cast.mass_a:.0f} g of A and {cast.mass_b:.0f} g of B, 10 % more"
            " than the moulds hold",
        ),
        BillItem(
            "rigid plastic for moulds, printed",
            f"{plastic:.0f} cm3",
            f"{count} pieces of {len(moulds)} moulds, as if printed solid",
        ),
        BillItem("release agent for silicone", "a spray can", "on all faces of the moulds"),
        BillItem("screw M3, 8 to 10 mm", "4 to 8 a mould", "or clamps, or rubber bands"),
    ]
