"""Building a device: what is up to date is kept, what changed is made anew and moved in whole.

A build works in `.build-next/` beside `build/` and trades places with it at the end, so an
error or an interruption leaves the last good build as it was. Finished stages stay there and are
taken up by the next build; where there is no build yet, they become it.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ...core.device.device import Device
from ...core.errors import CapacityError, DefsenseError, StorageError
from ...core.progress import Progress, silent
from ...core.storage.files import storage_errors, write_json
from ...core.storage.lock import locked
from . import body_sources
from .asked import PLATES, Asked, record, recorded
from .stages import STAGES, Solve, Stage, Watch, installed, keys, read_json
from .state import STATE, load_state

LOCK = ".build-lock"
_AS_IT_IS = Asked()


@dataclass(frozen=True)
class BuildResult:
    """The folder, and which stages were made and which were reused."""

    folder: Path
    made: tuple[str, ...]
    reused: tuple[str, ...]


def build(
    device: Device,
    until: str = "report",
    progress: Progress = silent,
    watch: Watch | None = None,
    asked: Asked = _AS_IT_IS,
    solve: Solve | None = None,
) -> BuildResult:
    """Run all stages up to `until`, reusing those that are up to date. `watch` sees what the search
    for cords comes to, which is the same whether it is seen or not; poses are solved by `solve`,
    where it is given, in place of on this machine. What is `asked` for in place of
    the device's own is kept with the build, also by builds that end before its parts.

    Raises a DefsenseError where a stage fails; `build/` is then untouched.
    """
    busy = f"{device.source}: another build of this device is running; wait for it"
    final, working, old = (device.source / n for n in ("build", ".build-next", ".build-old"))
    with storage_errors(device.source), locked(device.source / LOCK, busy):
        for path in (final, working, old):
            if path.is_symlink():
                raise StorageError(
                    f"{path}: is a symbolic link, which a build replaces; remove it, or link the"
                    " whole device folder instead"
                )
        if old.exists():  # a build was interrupted while trading places
            if final.exists():
                shutil.rmtree(old)
            else:
                old.replace(final)
        stages = STAGES[: [s.name for s in STAGES].index(until) + 1]
        if not asked.options and all(s.name != PLATES for s in stages):
            asked = recorded(device, final)
        own, device = device, asked.of(device)
        wanted = keys(device, final)
        if all(finished(device, final, s, wanted) for s in stages):
            return BuildResult(final, (), tuple(s.name for s in stages))
        working.mkdir(exist_ok=True)
        try:
            more = _given(watch, solve)
            made, reused = _make(own, asked, working, final, stages, progress, more)
        except (DefsenseError, OSError):
            _keep_what_is_new(device, working, final)
            raise
        if final.exists():
            final.replace(old)
        working.replace(final)
        shutil.rmtree(old, ignore_errors=True)
    return BuildResult(final, tuple(made), tuple(reused))


def _given(watch: Watch | None, solve: Solve | None) -> dict[str, dict[str, Any]]:
    """What stages are given beside the device, by their names."""
    given: dict[str, dict[str, Any]] = {} if solve is None else {"simulate": {"solve": solve}}
    return given | ({} if watch is None else {"optimize": {"watch": watch}})


def _make(
    own: Device,
    asked: Asked,
    working: Path,
    final: Path,
    stages: tuple[Stage, ...],
    progress: Progress,
    more: Mapping[str, Mapping[str, Any]],
) -> tuple[list[str], list[str]]:
    """Fill the `working` folder: the names of the stages that were made, and of those reused."""
    device, made, reused, versions = asked.of(own), [], [], installed()
    wanted = keys(device, final, versions)
    for stage in STAGES:
        if finished(device, working, stage, keys(device, working, versions)):
            reused.append(stage.name)
            continue
        _clear(working, stage)
        if stage is not STAGES[0]:  # from now on for the body in the working folder
            wanted = keys(device, working, versions)
        if finished(device, final, stage, wanted):
            for name in stage.outputs:
                if (final / name).exists():  # versions before wrote fewer
                    _copy(final / name, working / name)
            reused.append(stage.name)
        elif stage in stages:
            progress(stage.name, 0.0, stage.title)
            run_stage(stage, device, working, progress, more.get(stage.name, {}))
            progress(stage.name, 1.0, "done")
            made.append(stage.name)
        else:
            continue
        key = keys(device, working, versions)[stage.name]
        done = {"key": key, "files": _sizes(working, stage)} | record(stage.name, own, asked)
        write_json(working / STATE, {**load_state(working), stage.name: done})
    return made, reused


def _keep_what_is_new(device: Device, working: Path, final: Path) -> None:
    """After an error: the working folder goes where it has no finished stage that `final` lacks,
    and is `final` where there is none."""
    wanted = keys(device, working)
    done = [s for s in STAGES if finished(device, working, s, wanted)]
    for stage in STAGES[len(done) :]:  # what the failing stage began
        with suppress(OSError):
            _clear(working, stage)
    if all(finished(device, final, s, wanted) for s in done):
        shutil.rmtree(working, ignore_errors=True)
    elif not final.exists():
        working.replace(final)


@contextmanager
def undisturbed(device: Device) -> Iterator[Path]:
    """The folder `build/`, which no build replaces meanwhile. Raises StorageError while one runs,
    and where the device's folder is not to be written to."""
    busy = f"{device.source}: a build of this device is running; wait for it"
    with locked(device.source / LOCK, busy):
        yield device.source / "build"


def finished(device: Device, folder: Path, stage: Stage, wanted: dict[str, str]) -> bool:
    """Whether the stage's files are those that it left, none gone, none cut short, and made from
    what there is now."""
    left = load_state(folder).get(stage.name, {})
    if (left.get("key"), left.get("files")) != (wanted[stage.name], _sizes(folder, stage)):
        return False
    return stage is not STAGES[0] or body_sources.unchanged(device, folder)


def run_stage(
    stage: Stage,
    device: Device,
    folder: Path,
    progress: Progress,
    more: Mapping[str, Any] = MappingProxyType({}),
) -> None:
    """Make a stage's files; `more` is what its `run` is given. Raises a DefsenseError where it
    fails."""
    try:
        stage.run(device, folder, partial(progress, stage.name), **more)
    except MemoryError:
        raise CapacityError(
            f"{device.source}: the memory does not suffice to {stage.title}; {stage.lighter}"
        ) from None


def _sizes(folder: Path, stage: Stage) -> dict[str, int]:
    paths = [folder / name for name in stage.outputs]
    files = [f for p in paths for f in (sorted(p.rglob("*")) if p.is_dir() else [p])]
    return {str(f.relative_to(folder)): f.stat().st_size for f in files if f.is_file()}


def _clear(folder: Path, stage: Stage) -> None:
    for name in stage.outputs:
        target = folder / name
        if target.is_dir():
            shutil.rmtree(target)
        else:
            target.unlink(missing_ok=True)


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


def summary(folder: Path) -> dict[str, Any]:
    """The build's numbers as one record, from the files that are there."""
    out: dict[str, Any] = {"build": str(folder)}
    for key, path in (
        ("body", "body/body.json"),
        ("mesh", "mesh.json"),
        ("simulation", "fields/index.json"),
        ("layout", "layout.json"),
        ("manifest", "parts/manifest.json"),
    ):
        if (folder / path).exists():
            try:
                out[key] = read_json(folder / path)
            except ValueError:
                raise DefsenseError(f"{folder / path}: is damaged; delete {folder}") from None
    return out
