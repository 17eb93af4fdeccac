"""Search for poses that follow the body's vibration modes, and add them to the device."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import tomlkit
from tomlkit import TOMLDocument
from tomlkit.exceptions import TOMLKitError

from ....core.device.device_file import DEVICE, load_device
from ....core.errors import DeviceError
from ....workflow.study.options import ModesOptions
from ....workflow.study.propose_poses import (
    PoseSearch,
    ProposedPose,
    as_toml,
    extend_text,
    find_poses,
)
from ...background.background_job import JobReporter
from ...edits.edit import Edit, free_name


def search_poses(reporter: JobReporter, folder: Path, region: str) -> None:
    """Search for poses of the device in `folder`; run this in a BackgroundJob."""
    device = load_device(folder, complete=False)
    search = find_poses(device, ModesOptions(fixed=region), reporter.stage_progress)
    reporter.item((region, search))


def add_proposed(
    search: PoseSearch,
    poses: Sequence[ProposedPose],
    held: str,
    used_names: Sequence[str],
    *,
    has_states: bool,
) -> tuple[list[str], Edit]:
    """Return the edit that adds proposed poses, and the names that they get.

    Args:
        search: The search that has proposed them.
        poses: The poses to add.
        held: Region that holds the body.
        used_names: Names of the device's poses.
        has_states: Whether their states are added as well; otherwise, unless the device defines
            states, they follow from all poses.
    """
    taken, renamed = list(used_names), list[ProposedPose]()
    for pose in poses:
        renamed.append(replace(pose, name=free_name(pose.name, taken)))
        taken.append(renamed[-1].name)
    text = as_toml(renamed, held, search.region)
    if not has_states:
        added = tomlkit.parse(text)
        added.pop("states", None)
        text = tomlkit.dumps(added)
    names = [pose.name for pose in renamed]
    return names, _add_poses(", ".join(f"`{name}`" for name in names), text)


def _add_poses(names: str, text: str) -> Edit:
    def change(document: TOMLDocument) -> TOMLDocument:
        try:
            return tomlkit.parse(extend_text(tomlkit.dumps(document), text))
        except (TOMLKitError, tomllib.TOMLDecodeError) as error:
            raise DeviceError(
                f"the poses cannot be added ({error})", code="edit-not-possible", where=DEVICE
            ) from None

    return Edit(f"add the poses {names}", change)
