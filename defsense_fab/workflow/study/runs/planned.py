"""From the points of a study to its runs: each known by all that it depends on, those that share
their simulation together."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ....core.device.build_folder import refuse_outside
from ....core.device.device import Device
from ....core.device.device_file import DEVICE
from ....core.errors import DefsenseError, StudyError
from ....core.progress import Progress, silent
from ....core.storage.files import digest, storage_errors
from ...build.stages import Versions, installed_versions, stage_keys
from ..points.designs import points
from ..points.studied_device import known_keys, nearest, script_keys, studied_device
from ..points.study_toml import Study
from .device_files import DeviceFiles, pack

#: Fewer runs are not worth a simulation of their own.
_FEWEST = 4
#: Points between two reports of progress.
_TOLD = 500


@dataclass(frozen=True)
class Run:
    """A run by the hash of all that it depends on, with its values by key; the hash of what its
    simulation depends on; the `problem` for which there is no such device."""

    name: str
    values: Mapping[str, Any]
    simulation: str = ""
    problem: str = ""


@dataclass(frozen=True)
class Plan:
    """The runs in the order of the points, none twice; the text of `device.toml`, the device's
    files, and how many points there are."""

    runs: tuple[Run, ...]
    text: str
    files: DeviceFiles
    points: int


def planned(
    folder: Path, study: Study, fixed: Mapping[str, Any], progress: Progress = silent
) -> Plan:
    """The runs of a study of the device in a `folder`, with values that are `fixed` for all.

    Raises StudyError where no point gives a device, DeviceError for a parameter that is none or is
    fixed.
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
    with suppress(DefsenseError):  # a device may be whole only with the study's values
        base = studied_device(text, folder, fixed)
    runs: dict[str, Run] = {}
    versions = installed_versions()
    count, whole = 0, base
    for point in points(study):
        count += 1
        if count % _TOLD == 0:
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
            whole = whole or device
            run = _run(device, study, values, files, versions)
        runs.setdefault(run.name, run)
    if whole is not None:
        readable = (run.values for run in runs.values() if not run.problem)
        known = known_keys(text, next(readable, fixed))
        _refuse_unknown(study, [*known, *script_keys(whole)])
    if all(run.problem for run in runs.values()):
        first = next(iter(runs.values()))
        raise StudyError(
            f"study.toml: none of its {count} points gives a device; the first: {first.problem}"
        )
    return Plan(tuple(runs.values()), text, files, count)


def _run(
    device: Device, study: Study, values: Mapping[str, Any], files: DeviceFiles, versions: Versions
) -> Run:
    nowhere = device.source / "study"  # no body is there: the files' hash stands for it
    found = stage_keys(device, nowhere, versions)
    until = digest(files.digest, found[study.until])
    return Run(until, values, digest(files.digest, found["simulate"]))


def _refuse_unknown(study: Study, known: Sequence[str]) -> None:
    for parameter in study.parameters:
        if parameter.key not in known:
            near = nearest(parameter.key, known)
            action = f"Did you mean {' or '.join(near)}?" if near else "See docs/device.md"
            study.refuse(
                parameter.key,
                f"is not a key of {DEVICE}",
                "key-unknown",
                action,
                suggestions=near,
            )


def batches(runs: Sequence[Run], workers: int, most: int | None = None) -> list[tuple[Run, ...]]:
    """Runs that share their simulation together, at most so many in a batch, the longest batches
    first; they are divided where otherwise workers would stand idle. Each part has a simulation of
    its own."""
    groups: dict[str, list[Run]] = {}
    for run in runs:
        groups.setdefault(run.simulation, []).append(run)
    fair = len(runs) if workers == 1 else math.ceil(len(runs) / (2 * workers))
    fair = max(_FEWEST, min(fair, most or fair))
    out = []
    for group in groups.values():
        size = math.ceil(len(group) / math.ceil(len(group) / fair))
        out += [tuple(group[k : k + size]) for k in range(0, len(group), size)]
    return sorted(out, key=len, reverse=True)
