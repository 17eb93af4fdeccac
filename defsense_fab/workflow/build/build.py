"""Build a device: reuse the stages that are up to date, and replace the last build as a whole.

A build works in `.build-next/` and swaps it with `build/` at its end, so an error or an
interruption leaves the last good build unchanged. Stages that were complete by then go to
`.build-kept/`, where later builds find them until one succeeds as a whole; without any build they
become the build. The later stages of the last build also go there if a build is to end early.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

from ...core.device.device import Device
from ...core.errors import DefsenseError, StorageError
from ...core.progress import Progress, silent
from ...core.storage.files import file_lock, storage_errors, write_json
from ...store.build import Build
from ...store.layout import LAYOUT, load_layout, name_layout
from . import body_sources
from .cluster import cluster_solver, cluster_tasks
from .continued_layout import ASPECTS, find_earlier_layout, layout_aspects
from .options import BuildOptions
from .part_changes import MADE_OF, compare_parts, keep_changes, made_of
from .recorded_options import plates_record, recorded_options
from .stage_files import (
    STATE,
    complete_key,
    copy_files,
    file_sizes,
    keep_completed,
    load_state,
    remove_files,
    save_stage_record,
)
from .stages import PLATES, STAGES, Stage, StageKeys, Watch, installed_versions

LOCK = ".build-lock"
Freshness = Literal["current", "old", "missing"]
_NO_OPTIONS = BuildOptions()
_OPTIMIZE = "optimize"
#: Summary of a build by the files of its folder.
_SUMMARY_FILES = {
    "body": "body/body.json",
    "mesh": "mesh.json",
    "simulation": "fields/index.json",
    "layout": "layout.json",
    "forces": "forces.json",
    "manifest": "parts/manifest.json",
}


@dataclass(frozen=True)
class BuildResult:
    """A finished build.

    Attributes:
        folder: The build's folder.
        made: Names of the stages that were run.
        reused: Names of the stages that were up to date.
        results: The results, those of the stages that were run already in memory.
    """

    folder: Path
    made: tuple[str, ...]
    reused: tuple[str, ...]
    results: Build


def build(
    device: Device,
    until: str = "report",
    progress: Progress = silent,
    watch: Watch | None = None,
    options: BuildOptions = _NO_OPTIONS,
) -> BuildResult:
    """Run all stages up to `until`, reusing those that are up to date.

    Args:
        device: The device; its build is in the folder `build` of its `source`.
        until: Name of the last stage.
        progress: Receives each stage's name, completed fraction and a message.
        watch: Receives the layouts that the search for cords reaches; it does not change the
            result.
        options: Options that override `device.toml`; they are recorded with the build, and also
            apply to builds that end before the parts.

    Returns:
        The build's folder and results, and which stages were run.

    Raises:
        DefsenseError: A stage failed, or another build of the device is running; `build/` is then
            unchanged.
    """
    final, working, kept, old = (device.source / n for n in body_sources.BUILDS)
    with storage_errors(device.source), _lock(device, "another build of this device is running"):
        for path in (final, working, kept, old):
            if path.is_symlink():
                raise StorageError(
                    "is a symbolic link, which a build replaces",
                    code="build-is-link",
                    where=path,
                    action="Remove it, or link the whole device folder instead",
                )
        if old.exists():  # a build was interrupted while swapping folders
            if final.exists():
                keep_completed(old, kept, final)
            else:
                old.replace(final)
        stages = STAGES[: [s.name for s in STAGES].index(until) + 1]
        if not options.overrides and all(s.name != PLATES for s in stages):
            recorded = recorded_options(device, final)
            options = replace(recorded, scheduler=options.scheduler, search=options.search)
        plan = _Plan(device, options, stages)
        expected = plan.keys.of(final)
        if working.is_dir():  # a build was interrupted
            keep_completed(working, kept, final, spared=set(expected.values()))
        if all(plan.is_up_to_date(final, s) for s in stages):
            plan.update_options(final)
            return BuildResult(final, (), tuple(s.name for s in stages), Build(final))
        working.mkdir()
        extra: dict[str, dict[str, Any]] = {_OPTIMIZE: {}}
        if options.scheduler is not None:
            solve = cluster_solver(options.scheduler, partial(progress, "simulate", 0.0))
            map_tasks = cluster_tasks(options.scheduler, partial(progress, _OPTIMIZE, 0.0))
            extra = {"simulate": {"solve": solve}, _OPTIMIZE: {"map_tasks": map_tasks}}
        if watch is not None:
            extra[_OPTIMIZE]["watch"] = watch
        results = Build(working)
        try:
            made, reused = plan.run(results, (final, kept), progress, extra)
        except (DefsenseError, OSError):
            with suppress(DefsenseError, OSError):
                keep_completed(working, kept, final)
            raise
        if final.exists():
            final.replace(old)
        working.replace(final)
        results.folder = final
        if stages == STAGES:
            shutil.rmtree(kept, ignore_errors=True)
        elif old.exists():
            with suppress(DefsenseError, OSError):
                keep_completed(old, kept, final)  # a build of another mesh must not cost the layout
        shutil.rmtree(old, ignore_errors=True)
    return BuildResult(final, tuple(made), tuple(reused), results)


def _is_continued(folder: Path) -> bool:
    """Return whether the layout of a build was not found by a search, or cannot be read."""
    try:
        return bool(load_layout(folder).continued)
    except DefsenseError:
        return True


class _Plan:
    """The stages of one build, and which results they can reuse."""

    def __init__(self, device: Device, options: BuildOptions, stages: tuple[Stage, ...]) -> None:
        self.options, self.stages = options, stages
        self._original = device
        self.device = options.apply(device)
        self.keys = StageKeys(self.device, installed_versions())

    def is_up_to_date(self, folder: Path, stage: Stage, body: Path | None = None) -> bool:
        """Whether a folder has a stage's complete result for the body in `body` (the folder)."""
        if complete_key(folder, stage) != self.keys.of(body or folder)[stage.name]:
            return False
        if stage.name == _OPTIMIZE and self.options.search and _is_continued(folder):
            return False
        return stage is not STAGES[0] or body_sources.is_unchanged(self.device, folder)

    def run(
        self,
        results: Build,
        earlier: tuple[Path, ...],
        progress: Progress,
        extra: Mapping[str, Mapping[str, Any]],
    ) -> tuple[list[str], list[str]]:
        """Fill the empty folder of `results`.

        Args:
            results: The results of the build; its folder is empty.
            earlier: Folders of earlier builds, whose up-to-date stages are copied.
            progress: Receives each stage's name, completed fraction and a message.
            extra: Further arguments of stages, by their names.

        Returns:
            Names of the stages that were run, and of those that were reused.
        """
        made, reused = [], []
        extra = dict(extra)
        for stage in STAGES:
            source = self._find(stage, results.folder, earlier)
            if source is not None and self._copy(stage, source, results.folder):
                reused.append(stage.name)
            elif stage in self.stages:
                progress(stage.name, 0.0, stage.title)
                more = dict(extra.get(stage.name, {}))
                if stage.name == _OPTIMIZE and not self.options.search:
                    keys = self.keys.of(results.folder)
                    more["earlier"] = find_earlier_layout(self.device, keys, earlier)
                winner = stage.run(self.device, results, progress, **more)
                if stage.name == _OPTIMIZE and PLATES not in extra:
                    extra[PLATES] = {"winner": winner}
                progress(stage.name, 1.0, "done")
                made.append(stage.name)
            else:
                continue
            keys = self.keys.of(results.folder)
            key, files = keys[stage.name], file_sizes(results.folder, stage)
            record = plates_record(stage.name, self._original, self.options)
            if stage.name == PLATES:
                record[MADE_OF] = made_of(self.device)
                if source is not None and stage.name in reused:
                    record |= keep_changes(source)
                else:
                    record |= compare_parts(earlier, results.folder, record[MADE_OF])
            if stage.name == _OPTIMIZE:
                record[ASPECTS] = layout_aspects(self.device, keys)
            save_stage_record(results.folder, stage, {"key": key, "files": files} | record)
        return made, reused

    def update_options(self, folder: Path) -> None:
        """Record these options for plates that are up to date, whatever options made them."""
        state = load_state(folder)
        for stage in self.stages:
            record = state[stage.name] | plates_record(stage.name, self._original, self.options)
            if record != state[stage.name]:
                write_json(folder / STATE, {**state, stage.name: record})

    def _find(self, stage: Stage, working: Path, earlier: tuple[Path, ...]) -> Path | None:
        """Return the first folder with an up-to-date result of a stage.

        The body is compared with its own sources, later stages with the body in `working`.
        """
        for folder in earlier:
            body = folder if stage is STAGES[0] else working
            if self.is_up_to_date(folder, stage, body):
                return folder
        return None

    def _copy(self, stage: Stage, source: Path, working: Path) -> bool:
        """Copy a stage's files, with the device's present name; False if they are damaged."""
        copy_files(stage, source, working)
        try:
            if LAYOUT in stage.outputs:
                name_layout(working, self.device.name)
        except StorageError:
            remove_files(working, stage)
            return False
        return True


def build_body(device: Device, folder: Path, progress: Progress = silent) -> Build:
    """Load the body alone into a folder of its own, and leave the device's build unchanged.

    Raises:
        DefsenseError: The body cannot be loaded.
    """
    with storage_errors(folder):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        results = Build(folder)
        STAGES[0].run(device, results, progress)
        return results


def freshness(device: Device) -> dict[str, Freshness]:
    """Return whether each stage's result in the device's build is current, old or missing.

    Plates count as current if they were made with the options that the build records.
    """
    folder = device.source / "build"
    plan = _Plan(device, recorded_options(device, folder), STAGES)
    states: dict[str, Freshness] = {}
    for stage in STAGES:
        if not (folder / stage.outputs[0]).exists():  # earlier versions left fewer files
            states[stage.name] = "missing"
        elif set(states.values()) <= {"current"} and plan.is_up_to_date(folder, stage):
            states[stage.name] = "current"
        else:  # also if made from something old
            states[stage.name] = "old"
    return states


def first_outdated(device: Device, until: str = "report") -> Stage | None:
    """Return the first stage up to `until` with a missing or old result, or None."""
    states = freshness(device)
    for stage in STAGES:
        if states[stage.name] != "current":
            return stage
        if stage.name == until:
            break
    return None


@contextmanager
def build_lock(device: Device) -> Iterator[Path]:
    """Hold off builds of a device.

    Yields:
        The folder `build/`, which no build replaces meanwhile.

    Raises:
        StorageError: A build is running, or the device's folder is not writable.
    """
    with _lock(device, "a build of this device is running"):
        yield device.source / "build"


@contextmanager
def _lock(device: Device, problem: str) -> Iterator[None]:
    with file_lock(
        device.source / LOCK, problem, "build-running", device.source, "Wait for it to end"
    ):
        yield


def summary(folder: Path) -> dict[str, Any]:
    """Return the records of a build's folder, as far as they exist, for printing as JSON."""
    records: dict[str, Any] = {"build": str(folder)}
    for key, name in _SUMMARY_FILES.items():
        path = folder / name
        if path.exists():
            try:
                records[key] = json.loads(path.read_text(encoding="utf-8"))
            except ValueError:
                raise StorageError(
                    "is damaged", code="file-damaged", where=path, action=f"Delete {folder}"
                ) from None
    return records
