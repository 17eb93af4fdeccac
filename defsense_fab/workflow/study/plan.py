"""The runs of a study, each identified by a hash of all its inputs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...core.device.build_folder import own_files, refuse_outside
from ...core.device.device_file import DEVICE
from ...core.errors import DefsenseError, StudyError
from ...core.progress import Progress, silent
from ...core.storage.files import digest, storage_errors
from ..build import stages
from ..changed_values import changed_device
from .study_file import FILE as STUDY
from .study_file import VARIANT, Study

MAX_FILES_BYTES = 500e6  # of a device; they are sent to each worker
MIN_GROUP_RUNS = 4  # fewer runs are not worth their own simulation
POINTS_PER_REPORT = 500


@dataclass(frozen=True)
class Run:
    """A run of a study.

    Attributes:
        name: Hash of all its inputs.
        values: Values of the parameters and of those that are fixed, by key.
        changes: Values by dotted key of `device.toml`, those of the variant included.
        simulation: Hash of all inputs of its simulation.
        problem: Why there is no such device; else empty.
    """

    name: str
    values: Mapping[str, Any]
    changes: Mapping[str, Any]
    simulation: str = ""
    problem: str = ""


@dataclass(frozen=True)
class Plan:
    """The runs of a study.

    Attributes:
        runs: Different runs, in the order of the points.
        text: Text of `device.toml`.
        files: The device's files by path in its folder.
        points: Number of points.
    """

    runs: tuple[Run, ...]
    text: str
    files: Mapping[str, bytes]
    points: int


def read_files(folder: Path) -> dict[str, bytes]:
    """Read the files of a device, without results, recorded sessions and hidden files.

    Raises:
        StudyError: They are too large (`files-too-large`).
        StorageError: A file cannot be read.
    """
    contents, size = {}, 0
    for path in filter(Path.is_file, own_files(folder)):
        with storage_errors(path):
            size += path.stat().st_size
            if size > MAX_FILES_BYTES:
                raise StudyError(
                    f"contains more than {MAX_FILES_BYTES / 1e6:.0f} MB of files in addition to"
                    " results; they are sent to each worker",
                    code="files-too-large",
                    where=folder,
                    action="Move away the files that the body does not need",
                )
            contents[path.relative_to(folder).as_posix()] = path.read_bytes()
    return contents


def plan_runs(
    folder: Path, study: Study, fixed: Mapping[str, Any], progress: Progress = silent
) -> Plan:
    """Plan the runs of a study.

    Args:
        folder: Folder of the device.
        study: The study.
        fixed: Values by dotted key that are fixed for all runs.
        progress: Called with the progress.

    Raises:
        StudyError: No point gives a device (`no-valid-point`), or none of a variant
            (`variant-invalid`), or a parameter is fixed (`parameter-fixed`).
        StorageError: A file cannot be read.
    """
    for key in (p.key for p in study.parameters if p.key in fixed):
        action = "Vary it, or fix it, but not both"
        study.refuse(key, "is fixed for all runs", "parameter-fixed", action)
    with storage_errors(folder / DEVICE):
        text = (folder / DEVICE).read_text(encoding="utf-8")
    files = read_files(folder)
    own = [name for name in sorted(files) if name not in (DEVICE, STUDY)]
    content = digest(own, *(folder / name for name in own))
    versions = stages.installed_versions()
    runs: dict[str, Run] = {}
    refused: dict[str, DefsenseError] = {}
    valid = set()
    points = study.points()
    for count, point in enumerate(points, 1):
        if count % POINTS_PER_REPORT == 0:
            progress("study", 0.0, f"{count} points read")
        values, changes = {**fixed, **point}, study.changes({**fixed, **point})
        try:
            device = changed_device(text, folder, changes)
            refuse_outside(device)
        except DefsenseError as error:
            name = digest(content, sorted(values.items()), str(error))
            run = Run(name, values, changes, "", str(error))
            refused.setdefault(point.get(VARIANT, ""), error)
        else:
            valid.add(point.get(VARIANT, ""))
            # That folder has no body: the hash of the files replaces that of the body.
            keys = stages.stage_keys(device, device.source / "study", versions)
            name, simulation = (digest(content, keys[s]) for s in (study.file.until, "simulate"))
            run = Run(name, values, changes, simulation)
        runs.setdefault(run.name, run)
    for variant, problem in refused.items():
        if study.file.variants and variant not in valid:
            study.refuse_variant(variant, problem)
    if all(run.problem for run in runs.values()):
        first = next(iter(runs.values()))
        raise StudyError(
            f"none of its {len(points)} points gives a device; the first: {first.problem}",
            code="no-valid-point",
            where=STUDY,
            count=len(points),
        )
    return Plan(tuple(runs.values()), text, files, len(points))


def group_runs(
    runs: Sequence[Run], workers: int, limit: int | None = None
) -> list[tuple[Run, ...]]:
    """Group runs that share their simulation, the largest group first.

    Groups are divided if workers would be idle otherwise; each part then has its own simulation.

    Args:
        runs: The runs.
        workers: Number of workers.
        limit: Largest number of runs in a group; None for no limit.
    """
    by_simulation: dict[str, list[Run]] = {}
    for run in runs:
        by_simulation.setdefault(run.simulation, []).append(run)
    fair = len(runs) if workers == 1 else math.ceil(len(runs) / (2 * workers))
    fair = max(MIN_GROUP_RUNS, min(fair, limit or fair))
    groups: list[tuple[Run, ...]] = []
    for shared in by_simulation.values():
        size = math.ceil(len(shared) / math.ceil(len(shared) / fair))
        groups += [tuple(shared[k : k + size]) for k in range(0, len(shared), size)]
    return sorted(groups, key=len, reverse=True)
