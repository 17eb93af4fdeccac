"""The guide's steps as typed actions, for other programs: `guide.json` beside `guide.html`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...core.storage.files import write_json
from .guide import Guide
from .hands.actions import Action
from .hands.steps import GuideStep
from .hands.words import ENDS

SCHEMA = 1
FILE = "guide.json"


def write_guide_file(guide: Guide, path: Path) -> None:
    """Steps in their order, each with its actions in theirs: what is `do`ne, of which `cord`, `end`
    and `joint` (index of the manifest's `assembly`), by how many `mm`, what `ohm` it should
    measure, and the `lines` in which guide.html says it. Raises StorageError."""
    steps = plain_steps(guide.typed)
    write_json(path, {"schema": SCHEMA, "title": guide.title, "steps": steps})


def plain_steps(steps: Sequence[GuideStep]) -> list[dict[str, Any]]:
    """As they stand in the file."""
    return [
        {
            "number": number,
            "title": step.title,
            "actions": [
                _plain(action, lines)
                for passage in step.passages
                for action, lines in passage.actions
            ],
        }
        for number, step in enumerate(steps, start=1)
    ]


def _plain(action: Action, lines: tuple[str, ...]) -> dict[str, Any]:
    out: dict[str, Any] = {"do": str(action.kind)}
    if action.joint is not None:
        out["joint"] = action.joint
    if action.cord is not None:
        out["cord"] = action.cord
    if action.end is not None:
        out["end"] = ENDS[action.end]
    if action.amount is not None:
        out["mm"] = action.amount
    if action.expected:
        out["ohm"] = [
            {"cord": e.cord, "about": e.about, "low": e.low, "high": e.high}
            for e in action.expected
        ]
    out["lines"] = list(lines)
    return out
