"""Find which parts and cords a build changed: what to print and cut again, and what to keep.

Two printed pieces are the same if their files in print orientation are, and what they are printed
of. `state.json` keeps the result with the parts until other parts are made.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import msgspec

from ...core.device.device import Device
from ...core.errors import DefsenseError
from ...core.storage.files import digest
from ...report.guide.instructions import cord_label
from ...store.manifest import FOLDER, CutCord, Manifest, load_manifest, part_label
from .stage_files import load_state
from .stages import PLATES

CHANGES, MADE_OF = "changes", "made_of"
_CORD_TOLERANCE_MM = 0.5  # of lengths that are cut and marked by hand


@dataclass(frozen=True)
class PartChanges:
    """What a build changed compared with the parts of the build before it.

    Attributes:
        print_again: Names of the pieces that differ from all earlier ones, or of which more are
            needed.
        keep: Names of the pieces that are the same as an earlier one, and of cast parts.
        cut_again: Names of the cords of another kind or length than before, or of which more are
            needed.
        keep_cords: Names of the other cords.
        cast_again: Names of the parts that must be cast again: their mould or the silicone has
            changed, or more of them are needed.
    """

    print_again: tuple[str, ...]
    keep: tuple[str, ...]
    cut_again: tuple[str, ...]
    keep_cords: tuple[str, ...]
    cast_again: tuple[str, ...] = ()

    def describe(self) -> list[str]:
        """Return the changes as sentences."""
        rows = self.rows()
        again = {verb: [n for n, what in rows if what == f"{verb} again"] for verb in _VERBS}
        kept = [n for n, what in rows if what == _KEEP]
        lines = [f"{verb.capitalize()} again: {', '.join(n)}." for verb, n in again.items() if n]
        if kept:
            lines.append(f"Keep: {', '.join(kept)}.")
        return lines

    def rows(self) -> list[tuple[str, str]]:
        """Return the label of each piece with what to do, "print again" or "keep" for example."""
        return [
            *((part_label(name), "print again") for name in self.print_again),
            *((part_label(name), "cast again") for name in self.cast_again),
            *((cord_label(name), "cut again") for name in self.cut_again),
            *((part_label(name), _KEEP) for name in self.keep),
            *((cord_label(name), _KEEP) for name in self.keep_cords),
        ]


_VERBS, _KEEP = ("print", "cast", "cut"), "keep"


def made_of(device: Device) -> dict[str, list[Any]]:
    """Return what `state.json` records of what pieces and cords are made of."""
    f, cord = device.fabrication, device.cord
    material = [device.material.name]
    is_cast, filament = f.kind == "cast", [] if cord.trace is None else [cord.name]
    return {
        "pieces": [f.process, *([] if is_cast else material), *filament],
        "cast": material if is_cast else [],
        "cords": [cord.name, cord.diameter],
    }


def compare_parts(earlier: Sequence[Path], folder: Path, made: Mapping[str, Any]) -> dict[str, Any]:
    """Return what `state.json` records of the changes between the parts of two builds.

    Args:
        earlier: Folders of earlier builds, the latest first; the first one with readable parts is
            compared with.
        folder: Folder of the new build.
        made: What its pieces and cords are made of.

    Returns:
        The record; empty without earlier parts.
    """
    found = next(filter(None, map(_read, earlier)), None)
    if found is None:
        return {}
    path, before = found
    after, made_before = load_manifest(folder), _record(path).get(MADE_OF)
    if not isinstance(made_before, dict):  # no record, or one of another version
        made_before = made
    same = {key: made_before.get(key) == value for key, value in made.items()}
    pieces, known = _pieces(folder, after), Counter[str]()
    for value, count in _pieces(path, before).values():
        known[value] += count
    needed = Counter[str]()
    for value, count in pieces.values():
        needed[value] += count
    again = [n for n, (v, _) in pieces.items() if not same["pieces"] or needed[v] > known[v]]
    cords = () if after.traces else after.cords
    cut_again = [
        c.sensor
        for c in cords
        if not same["cords"] or after.copies > before.copies or not _is_kept(c, before.cords)
    ]
    is_recast = not same["cast"] or after.copies > before.copies
    cast_again = [
        m.part for m in after.moulds if is_recast or any(p.name in again for p in m.pieces)
    ]
    kept = [m.part for m in after.moulds if m.part not in cast_again]
    changes = PartChanges(
        print_again=tuple(again),
        keep=(*kept, *(name for name in pieces if name not in again)),
        cut_again=tuple(cut_again),
        keep_cords=tuple(c.sensor for c in cords if c.sensor not in cut_again),
        cast_again=tuple(cast_again),
    )
    return {CHANGES: asdict(changes)}


def keep_changes(folder: Path) -> dict[str, Any]:
    """Return what `state.json` records of the changes of parts that are used again."""
    changes = load_changes(folder)
    return {} if changes is None else {CHANGES: asdict(changes)}


def load_changes(folder: Path) -> PartChanges | None:
    """Return what a build changed; None if there were no parts before it."""
    try:
        return msgspec.convert(_record(folder).get(CHANGES), PartChanges)
    except msgspec.ValidationError:  # no record, or one of another version
        return None


def _record(folder: Path) -> dict[str, Any]:
    record = load_state(folder).get(PLATES)
    return record if isinstance(record, dict) else {}


def _read(folder: Path) -> tuple[Path, Manifest] | None:
    """Return a folder with its manifest; None without readable parts."""
    try:
        manifest = load_manifest(folder)
        _pieces(folder, manifest)
    except (DefsenseError, OSError):
        return None
    return folder, manifest


def _pieces(folder: Path, manifest: Manifest) -> dict[str, tuple[str, int]]:
    """Return a hash and the number of each printed piece, by its name.

    A body is one piece with the traces in it.
    """
    path, copies = folder / FOLDER, manifest.copies
    traces = [path / trace.stl for trace in manifest.traces]
    moulds = [piece for mould in manifest.moulds for piece in mould.pieces]
    pieces = {p.name: (digest(path / p.print), 1) for p in moulds}
    if not moulds:
        pieces = {p.name: (digest(path / p.print, *traces), copies) for p in manifest.parts}
    return pieces | {p.name: (digest(path / p.stl), p.count * copies) for p in manifest.pins}


def _is_kept(cord: CutCord, before: Sequence[CutCord]) -> bool:
    return any(
        b.sensor == cord.sensor
        and abs(b.cut_length - cord.cut_length) <= _CORD_TOLERANCE_MM
        and abs(b.unstretched - cord.unstretched) <= _CORD_TOLERANCE_MM
        for b in before
    )
