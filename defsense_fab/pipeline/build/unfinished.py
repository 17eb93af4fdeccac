"""What builds finished that came to no end: kept stage by stage, for the next that can use it."""

from __future__ import annotations

import shutil
from pathlib import Path

from .stage_files import move, remove, whole_key
from .stages import STAGES


def keep(working: Path, kept: Path, final: Path) -> None:
    """Move the finished stages in `working` to `kept`, but those that are there or in `final`
    already; `working` is gone then. Where there is no build at all, `working` becomes it."""
    keys = {s: key for s in STAGES if (key := whole_key(working, s)) is not None}
    if keys and not final.exists():
        for stage in STAGES:
            if stage not in keys:  # what the failing stage began
                remove(working, stage)
        working.replace(final)
        return
    for stage, key in keys.items():
        if key not in (whole_key(final, stage), whole_key(kept, stage)):
            kept.mkdir(exist_ok=True)
            move(stage, working, kept)
    shutil.rmtree(working)
