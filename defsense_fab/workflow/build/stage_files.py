"""The files that stages leave in a build's folder, and `state.json`, which records them.

`state.json` holds for each completed stage the key of all that its result depends on, and the sizes
of its files. A stage's files are complete if they still have these sizes.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Container
from pathlib import Path
from typing import Any

from ...core.storage.files import write_json
from .stages import STAGES, Stage

STATE = "state.json"


def load_state(folder: Path) -> dict[str, Any]:
    """Return the records of the completed stages by name; empty without a readable `state.json`."""
    try:
        state = json.loads((folder / STATE).read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):
        return {}
    return state if isinstance(state, dict) else {}


def save_stage_record(folder: Path, stage: Stage, record: dict[str, Any]) -> None:
    """Record in `state.json` that a stage is complete."""
    write_json(folder / STATE, {**load_state(folder), stage.name: record})


def file_sizes(folder: Path, stage: Stage) -> dict[str, int]:
    """Return the size of each file of a stage, in bytes, by its path in the folder."""
    paths = [folder / name for name in stage.outputs]
    files = [f for p in paths for f in (sorted(p.rglob("*")) if p.is_dir() else [p])]
    return {f.relative_to(folder).as_posix(): f.stat().st_size for f in files if f.is_file()}


def complete_key(folder: Path, stage: Stage) -> str | None:
    """Return the key that a stage's files were made for; None if a file is missing or truncated."""
    record = load_state(folder).get(stage.name, {})
    return record.get("key") if record.get("files") == file_sizes(folder, stage) else None


def remove_files(folder: Path, stage: Stage) -> None:
    """Delete a stage's files, as far as they exist."""
    for name in stage.outputs:
        target = folder / name
        if target.is_dir():
            shutil.rmtree(target)
        else:
            target.unlink(missing_ok=True)


def copy_files(stage: Stage, source: Path, target: Path) -> None:
    """Copy a stage's files, as far as they exist, from one build folder to another."""
    for name in stage.outputs:
        if (source / name).exists():
            _copy(source / name, target / name)


def move_files(stage: Stage, source: Path, target: Path) -> None:
    """Move a stage's files and its record, replacing those of the target.

    If this is interrupted, no files are left that count as complete.
    """
    record, state = load_state(source)[stage.name], load_state(target)
    state.pop(stage.name, None)
    write_json(target / STATE, state)
    remove_files(target, stage)
    for name in stage.outputs:
        if (source / name).exists():
            (source / name).replace(target / name)
    write_json(target / STATE, {**state, stage.name: record})


def keep_completed(
    working: Path, kept: Path, final: Path, spared: Container[str | None] = ()
) -> None:
    """Keep the completed stages of a build that ended early, and remove its folder.

    Args:
        working: Folder of the build that ended early; it is removed.
        kept: Folder that collects completed stages for later builds.
        final: Folder of the last good build. Without one, `working` becomes it.
        spared: Keys of stages in `kept` that must not be replaced.
    """
    keys = {s: key for s in STAGES if (key := complete_key(working, s)) is not None}
    if keys and not final.exists():
        for stage in STAGES:
            if stage not in keys:  # files of the stage that failed
                remove_files(working, stage)
        working.replace(final)
        return
    for stage, key in keys.items():
        kept_key = complete_key(kept, stage)
        if key not in (complete_key(final, stage), kept_key) and kept_key not in spared:
            kept.mkdir(exist_ok=True)
            move_files(stage, working, kept)
    shutil.rmtree(working)


def _copy(source: Path, target: Path) -> None:
    """Copy by hard links where the file system has them: completed files are never rewritten."""
    try:
        if source.is_dir():
            shutil.copytree(source, target, copy_function=os.link)
        else:
            os.link(source, target)
    except (OSError, shutil.Error):
        if source.is_dir():
            shutil.rmtree(target, ignore_errors=True)  # some links may exist
            shutil.copytree(source, target)
        else:
            shutil.copy2(source, target)
