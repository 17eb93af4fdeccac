"""What builds finished that came to no end: kept stage by stage, for the next that can use it."""

from __future__ import annotations

import shutil
from collections.abc import Container
from pathlib import Path

from .stage_files import move, remove, whole_key
from .stages import STAGES


def keep(working: Path, kept: Path, final: Path, spared: Container[str | None] = ()) -> None:
    """Move the finished stages in `working` to `kept`, but those that are there or in `final`
    already, or whose place a stage has whose key is to be `spared`; `working` is gone then. Where
    there is no build at all, `working` becomes it."""
    keys = {s: key for s in STAGES if (key := whole_key(working, s)) is not None}
    if keys and not final.exists():
        for stage in STAGES:
            if stage not in keys:  # what the failing stage began
                remove(working, stage)
        working.replace(final)
        return
    for stage, key in keys.items():
        there = whole_key(kept, stage)
        if key not in (whole_key(final, stage), there) and there not in spared:
            kept.mkdir(exist_ok=True)
            move(stage, working, kept)
    shutil.rmtree(working)
