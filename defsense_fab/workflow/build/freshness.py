"""What of a build is of the device as it is now, and the body alone, beside the build."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Literal

from ...core.device.device import Device
from ...core.progress import Progress, silent
from ...core.storage.files import storage_errors
from .asked import recorded
from .build import finished, run_stage
from .stages import STAGES, Stage, keys

State = Literal["current", "old", "missing"]


def freshness(device: Device) -> dict[str, State]:
    """Of each stage's result in the device's build: is it there, and what would be made again? For
    copies and a bed that the build was asked for it counts as it was made."""
    folder = device.source / "build"
    device = recorded(device, folder).of(device)
    wanted = keys(device, folder)
    out: dict[str, State] = {}
    for stage in STAGES:
        if not (folder / stage.outputs[0]).exists():  # versions before left fewer beside it
            out[stage.name] = "missing"
        elif set(out.values()) <= {"current"} and finished(device, folder, stage, wanted):
            out[stage.name] = "current"
        else:  # also what was made of something old
            out[stage.name] = "old"
    return out


def outdated(device: Device, until: str = "report") -> Stage | None:
    """The first stage up to `until` whose result is missing or old; None where there is none."""
    states = freshness(device)
    for stage in STAGES:
        if states[stage.name] != "current":
            return stage
        if stage.name == until:
            break
    return None


def build_body(device: Device, folder: Path, progress: Progress = silent) -> None:
    """The body alone, in a `folder` of its own: the build of the device stays, with the poses that
    took long. Raises a DefsenseError where the body cannot be made."""
    with storage_errors(folder):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        run_stage(STAGES[0], device, folder, progress)
