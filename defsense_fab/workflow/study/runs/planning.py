"""Planning of a study: its points, their runs, and batches of runs that share a simulation.

Each run is identified by a hash of all its inputs.
"""

from __future__ import annotations

import hashlib
import io
import itertools
import math
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ....core.device.build_folder import own_files, refuse_outside
from ....core.device.device import Device
from ....core.device.device_file import DEVICE
from ....core.errors import DefsenseError, StudyError
from ....core.progress import Progress, silent
from ....core.storage.files import digest, storage_errors
from ...build.stages import Versions, installed_versions, stage_keys
from ..points.studied_device import find_similar_keys, known_keys, script_keys, studied_device
from ..points.study_toml import FILE as STUDY
from ..points.study_toml import Study

MAX_FILES_BYTES = 500e6  # of a device, which are sent with each batch
_ARCHIVE_DATE = (2000, 1, 1, 0, 0, 0)  # of all files, so that archives of equal files are equal


@dataclass(frozen=True)
class DeviceFiles:
    """The files of a device's folder, which are all that a run needs of this machine.

    Attributes:
        archive: ZIP archive of the files.
        digest: Hash of their contents, without `device.toml` and `study.toml`.
    """

    archive: bytes
    digest: str


def pack(folder: Path) -> DeviceFiles:
    """Pack the files of a device's folder, without results, recorded sessions and hidden files.

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
                    f"contains more than {MAX_FILES_BYTES / 1e6:.0f} MB besides its results, which"
                    " are sent with every batch of runs",
                    code="files-too-large",
                    where=folder,
                    action="Move away the files that the body does not need",
                )
            contents[path.relative_to(folder).as_posix()] = path.read_bytes()
    buffer, content_hash = io.BytesIO(), hashlib.sha256()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in sorted(contents.items()):
            archive.writestr(zipfile.ZipInfo(name, _ARCHIVE_DATE), data, zipfile.ZIP_DEFLATED)
            if name not in (DEVICE, STUDY):
                content_hash.update(f"{name}\0{len(data)}\0".encode() + data)
    return DeviceFiles(buffer.getvalue(), content_hash.hexdigest()[:16])


def unpack(archive: bytes, folder: Path) -> None:
    """Unpack the files of a device to a new folder.

    Raises:
        StorageError: Files cannot be written.
    """
    with storage_errors(folder), zipfile.ZipFile(io.BytesIO(archive)) as files:
        files.extractall(folder)


#: Values of all parameters by key; one point per run.
Point = Mapping[str, Any]


def design_points(study: Study) -> list[Point]:
    """Return all points of a study's design, always the same for the same study."""
    keys = [p.key for p in study.parameters]
    if study.design == "latin-hypercube":
        shares = _latin_hypercube(study.count, len(keys), study.seed)
        return [
            {p.key: p.at(float(u)) for p, u in zip(study.parameters, row, strict=True)}
            for row in shares
        ]
    combined = itertools.product if study.design == "grid" else zip
    rows = combined(*(p.values for p in study.parameters))
    return [dict(zip(keys, row, strict=True)) for row in rows]


def _latin_hypercube(count: int, dimensions: int, seed: int) -> np.ndarray[Any, Any]:
    """Return shares (count, dimensions) in [0, 1); each column has one per interval of 1/count."""
    from scipy.stats import qmc

    return np.asarray(qmc.LatinHypercube(dimensions, rng=seed).random(count))


MIN_BATCH_RUNS = 4  # fewer runs are not worth their own simulation
POINTS_PER_REPORT = 500


@dataclass(frozen=True)
class Run:
    """A run of a study.

    Attributes:
        name: Hash of all its inputs.
        values: Values by dotted key of `device.toml`.
        simulation: Hash of all inputs of its simulation.
        problem: Why there is no such device; else empty.
    """

    name: str
    values: Mapping[str, Any]
    simulation: str = ""
    problem: str = ""


@dataclass(frozen=True)
class Plan:
    """The runs of a study.

    Attributes:
        runs: Different runs, in the order of the points.
        text: Text of `device.toml`.
        files: The device's files.
        points: Number of points.
    """

    runs: tuple[Run, ...]
    text: str
    files: DeviceFiles
    points: int


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
        StudyError: No point gives a device (`no-valid-point`).
        DeviceError: A parameter does not exist, or is fixed.
    """
    for key in (p.key for p in study.parameters if p.key in fixed):
        study.refuse(
            key,
            "is fixed for all runs",
            "parameter-fixed",
            "Vary it, or fix it, but not both",
        )
    with storage_errors(folder / DEVICE):
        text = (folder / DEVICE).read_text(encoding="utf-8")
    files = pack(folder)
    base: Device | None = None
    with suppress(DefsenseError):  # a device may be complete only with the study's values
        base = studied_device(text, folder, fixed)
    runs: dict[str, Run] = {}
    versions = installed_versions()
    count, complete = 0, base
    for point in design_points(study):
        count += 1
        if count % POINTS_PER_REPORT == 0:
            progress("study", 0.0, f"{count} points read")
        values = {**fixed, **point}
        try:
            device = studied_device(text, folder, values)
            refuse_outside(device)
        except DefsenseError as error:
            run = Run(
                digest(files.digest, sorted(values.items()), str(error)), values, "", str(error)
            )
        else:
            complete = complete or device
            run = _plan_run(device, study, values, files, versions)
        runs.setdefault(run.name, run)
    if complete is not None:
        readable = (run.values for run in runs.values() if not run.problem)
        known = known_keys(text, next(readable, fixed))
        _refuse_unknown(study, [*known, *script_keys(complete)])
    if all(run.problem for run in runs.values()):
        first = next(iter(runs.values()))
        raise StudyError(
            f"none of its {count} points gives a device; the first: {first.problem}",
            code="no-valid-point",
            where="study.toml",
            count=count,
        )
    return Plan(tuple(runs.values()), text, files, count)


def _plan_run(
    device: Device, study: Study, values: Mapping[str, Any], files: DeviceFiles, versions: Versions
) -> Run:
    # In that folder there is no body: the hash of the files replaces that of the body.
    keys = stage_keys(device, device.source / "study", versions)
    until = digest(files.digest, keys[study.until])
    return Run(until, values, digest(files.digest, keys["simulate"]))


def _refuse_unknown(study: Study, known: Sequence[str]) -> None:
    for parameter in study.parameters:
        if parameter.key not in known:
            suggestions = find_similar_keys(parameter.key, known)
            action = (
                f"Did you mean {' or '.join(suggestions)}?" if suggestions else "See docs/device.md"
            )
            study.refuse(
                parameter.key,
                f"is not a key of {DEVICE}",
                "key-unknown",
                action,
                suggestions=suggestions,
            )


def group_runs(
    runs: Sequence[Run], workers: int, limit: int | None = None
) -> list[tuple[Run, ...]]:
    """Group runs that share their simulation into batches, the longest first.

    Groups are divided if workers would be idle otherwise; each part then has its own simulation.

    Args:
        runs: The runs.
        workers: Number of workers.
        limit: Largest number of runs in a batch; None for no limit.
    """
    groups: dict[str, list[Run]] = {}
    for run in runs:
        groups.setdefault(run.simulation, []).append(run)
    fair = len(runs) if workers == 1 else math.ceil(len(runs) / (2 * workers))
    fair = max(MIN_BATCH_RUNS, min(fair, limit or fair))
    batches: list[tuple[Run, ...]] = []
    for group in groups.values():
        size = math.ceil(len(group) / math.ceil(len(group) / fair))
        batches += [tuple(group[k : k + size]) for k in range(0, len(group), size)]
    return sorted(batches, key=len, reverse=True)
