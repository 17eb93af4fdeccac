"""Building a device: what is up to date is kept, what changed is made anew and moved in whole.

A build works in `.build-next/` beside `build/` and trades places with it at the end, so an
error or an interruption leaves the last good build as it was. Stages that were finished by then go
to `.build-kept/`, where the next builds find them until one succeeds as a whole; where there is no
build yet, they become it. So do the later stages of the build before, where a build ends early.
"""

from __future__ import annotations

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
from ...core.storage.files import file_lock, storage_errors, write_json
from ...sensing.layout import LAYOUT, name_layout
from . import body_sources, stage_files
from .asked import PLATES, Asked, record, recorded
from .stages import STAGES, Solve, Stage, Versions, Watch, installed, keys, read_json
from .state import STATE, load_state
from .unfinished import keep

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
    final, working, kept, old = (device.source / n for n in body_sources.BUILDS)
    with storage_errors(device.source), file_lock(device.source / LOCK, busy):
        for path in (final, working, kept, old):
            if path.is_symlink():
                raise StorageError(
                    f"{path}: is a symbolic link, which a build replaces; remove it, or link the"
                    " whole device folder instead"
                )
        if old.exists():  # a build was interrupted while trading places
            if final.exists():
                keep(old, kept, final)
            else:
                old.replace(final)
        stages = STAGES[: [s.name for s in STAGES].index(until) + 1]
        if not asked.options and all(s.name != PLATES for s in stages):
            asked = recorded(device, final)
        own, device = device, asked.of(device)
        wanted = keys(device, final)
        if working.is_dir():  # a build was interrupted
            keep(working, kept, final, spared=set(wanted.values()))
        if all(finished(device, final, s, wanted) for s in stages):
            _say_anew(final, stages, own, asked)
            return BuildResult(final, (), tuple(s.name for s in stages))
        working.mkdir()
        try:
            more = _given(watch, solve)
            made, reused = _make(own, asked, working, (final, kept), stages, progress, more)
        except (DefsenseError, OSError):
            with suppress(DefsenseError, OSError):
                keep(working, kept, final)
            raise
        if final.exists():
            final.replace(old)
        working.replace(final)
        if stages == STAGES:
            shutil.rmtree(kept, ignore_errors=True)
        elif old.exists():
            with suppress(DefsenseError, OSError):
                keep(old, kept, final)  # a look at another mesh costs no layout
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
    before: tuple[Path, ...],
    stages: tuple[Stage, ...],
    progress: Progress,
    more: Mapping[str, Mapping[str, Any]],
) -> tuple[list[str], list[str]]:
    """Fill the empty `working` folder, with what there is in those of `before`: the names of the
    stages that were made, and of those reused."""
    device, made, reused, versions = asked.of(own), [], [], installed()
    for stage in STAGES:
        source = _where(stage, device, working, before, versions)
        if source is not None and _copied(stage, source, working, device):
            reused.append(stage.name)
        elif stage in stages:
            progress(stage.name, 0.0, stage.title)
            run_stage(stage, device, working, progress, more.get(stage.name, {}))
            progress(stage.name, 1.0, "done")
            made.append(stage.name)
        else:
            continue
        key = keys(device, working, versions)[stage.name]
        files = stage_files.sizes(working, stage)
        done = {"key": key, "files": files} | record(stage.name, own, asked)
        write_json(working / STATE, {**load_state(working), stage.name: done})
    return made, reused


def _copied(stage: Stage, source: Path, working: Path, device: Device) -> bool:
    """Whether the stage's files are in the `working` folder now, under the device's name, which may
    be another than before; not where they are damaged."""
    stage_files.copy(stage, source, working)
    try:
        if LAYOUT in stage.outputs:
            name_layout(working, device.name)
    except StorageError:
        stage_files.remove(working, stage)
        return False
    return True


def _where(
    stage: Stage, device: Device, working: Path, before: tuple[Path, ...], versions: Versions
) -> Path | None:
    """The first of the folders of `before` in which a stage is up to date: for the body that is
    there, if it is the body's, and for that in the `working` folder from then on."""
    for folder in before:
        body = folder if stage is STAGES[0] else working
        if finished(device, folder, stage, keys(device, body, versions)):
            return folder
    return None


def _say_anew(final: Path, stages: tuple[Stage, ...], own: Device, asked: Asked) -> None:
    """Plates that are up to date are from now on those of this build, whatever the one that made
    them was asked for."""
    state = load_state(final)
    for stage in stages:
        said = state[stage.name] | record(stage.name, own, asked)
        if said != state[stage.name]:
            write_json(final / STATE, {**state, stage.name: said})


@contextmanager
def undisturbed(device: Device) -> Iterator[Path]:
    """The folder `build/`, which no build replaces meanwhile. Raises StorageError while one runs,
    and where the device's folder is not to be written to."""
    busy = f"{device.source}: a build of this device is running; wait for it"
    with file_lock(device.source / LOCK, busy):
        yield device.source / "build"


def finished(device: Device, folder: Path, stage: Stage, wanted: dict[str, str]) -> bool:
    """Whether the stage's files are those that it left, none gone, none cut short, and made from
    what there is now."""
    if stage_files.whole_key(folder, stage) != wanted[stage.name]:
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
