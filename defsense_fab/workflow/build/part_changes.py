"""Find which parts and cords a build changed: what to print and cut again, and what to keep.

Two printed pieces are the same if their files in print orientation are. `state.json` keeps the
result with the parts until other parts are made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...core.errors import DefsenseError
from ...core.storage.files import digest
from ...store.manifest import FOLDER, CutCord, Manifest, load_manifest
from ...store.manifest import part_label as part_label
from .stage_files import load_state
from .stages import PLATES

CHANGES = "changes"
_CORD_TOLERANCE_MM = 0.5  # of lengths that are cut and marked by hand


@dataclass(frozen=True)
class PartChanges:
    """What a build changed compared with the parts before it.

    Attributes:
        print_again: Names of the pieces that differ from all earlier ones.
        keep: Names of the pieces that are the same as an earlier one.
        cut_again: Names of the cords that have another length than before, or are new.
        keep_cords: Names of the other cords.
    """

    print_again: tuple[str, ...]
    keep: tuple[str, ...]
    cut_again: tuple[str, ...]
    keep_cords: tuple[str, ...]

    def describe(self) -> list[str]:
        """Return the changes as sentences."""
        return [
            _describe("Print", self.print_again, "keep", self.keep),
            _describe("Cut", self.cut_again, "keep", self.keep_cords),
        ]


def _describe(verb: str, again: tuple[str, ...], other: str, kept: tuple[str, ...]) -> str:
    if not again:
        return f"{verb} nothing again: {', '.join(map(part_label, kept))} stay as they were."
    text = f"{verb} again: {', '.join(map(part_label, again))}"
    return f"{text}; {other} {', '.join(map(part_label, kept))}." if kept else f"{text}."


def compare_parts(earlier: Path, folder: Path) -> dict[str, Any]:
    """Return what `state.json` records of the changes between the parts of two builds.

    It is empty if the earlier folder has no readable parts.
    """
    try:
        before = load_manifest(earlier)
        known = set(_digests(earlier, before).values())
    except (DefsenseError, OSError):
        return {}
    after = load_manifest(folder)
    pieces = _digests(folder, after)
    lengths = {c.sensor: _lengths(c) for c in before.cords}
    cut_again = [c.sensor for c in after.cords if not _is_kept(c, lengths)]
    changes = PartChanges(
        print_again=tuple(name for name, value in pieces.items() if value not in known),
        keep=tuple(name for name, value in pieces.items() if value in known),
        cut_again=tuple(cut_again),
        keep_cords=tuple(c.sensor for c in after.cords if c.sensor not in cut_again),
    )
    return {CHANGES: asdict(changes)}


def load_changes(folder: Path) -> PartChanges | None:
    """Return what a build changed; None if there were no parts before it."""
    record: Mapping[str, Any] | None = load_state(folder).get(PLATES, {}).get(CHANGES)
    return None if record is None else PartChanges(**{k: tuple(v) for k, v in record.items()})


def _digests(folder: Path, manifest: Manifest) -> dict[str, str]:
    """Return a hash of the file of each printed piece, by its name."""
    pieces = [piece for mould in manifest.moulds for piece in mould.pieces]
    files = {p.name: p.print for p in (pieces or manifest.parts)}
    files |= {trace.name: trace.stl for trace in manifest.traces}
    files |= {pin.name: pin.stl for pin in manifest.pins}
    return {name: digest(folder / FOLDER / file) for name, file in files.items()}


def _lengths(cord: CutCord) -> tuple[float, float]:
    return cord.cut_length, cord.unstretched


def _is_kept(cord: CutCord, lengths: Mapping[str, tuple[float, float]]) -> bool:
    before = lengths.get(cord.sensor)
    return before is not None and all(
        abs(a - b) <= _CORD_TOLERANCE_MM for a, b in zip(_lengths(cord), before, strict=True)
    )
