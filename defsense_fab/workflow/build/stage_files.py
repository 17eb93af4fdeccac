"""The files that a stage leaves in a build's folder: whole or not, removed, copied, moved."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from ...core.storage.files import write_json
from .stages import Stage
from .state import STATE, load_state


def sizes(folder: Path, stage: Stage) -> dict[str, int]:
    """Of every file of the stage, by its name in the folder."""
    paths = [folder / name for name in stage.outputs]
    files = [f for p in paths for f in (sorted(p.rglob("*")) if p.is_dir() else [p])]
    return {f.relative_to(folder).as_posix(): f.stat().st_size for f in files if f.is_file()}


def whole_key(folder: Path, stage: Stage) -> str | None:
    """The key that the stage's files were made for; None where they are not those that it left,
    one being gone or cut short."""
    left = load_state(folder).get(stage.name, {})
    return left.get("key") if left.get("files") == sizes(folder, stage) else None


def remove(folder: Path, stage: Stage) -> None:
    """The stage's files, as far as they are there."""
    for name in stage.outputs:
        target = folder / name
        if target.is_dir():
            shutil.rmtree(target)
        else:
            target.unlink(missing_ok=True)


def copy(stage: Stage, source: Path, target: Path) -> None:
    """The stage's files, as far as they are there: versions before wrote fewer."""
    for name in stage.outputs:
        if (source / name).exists():
            _copy(source / name, target / name)


def move(stage: Stage, source: Path, target: Path) -> None:
    """The stage's files with what `state.json` says of them, in place of those of the `target`. An
    interruption leaves none that count as whole."""
    said, state = load_state(source)[stage.name], load_state(target)
    state.pop(stage.name, None)
    write_json(target / STATE, state)
    remove(target, stage)
    for name in stage.outputs:
        if (source / name).exists():
            (source / name).replace(target / name)
    write_json(target / STATE, {**state, stage.name: said})


def _copy(source: Path, target: Path) -> None:
    """Hard links where the file system has them: finished files are never written again."""
    try:
        if source.is_dir():
            shutil.copytree(source, target, copy_function=os.link)
        else:
            os.link(source, target)
    except (OSError, shutil.Error):
        if source.is_dir():
            shutil.rmtree(target, ignore_errors=True)  # some links may be there
            shutil.copytree(source, target)
        else:
            shutil.copy2(source, target)
