"""Keep a simulation valid when only the name of a pose has changed."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

from ...core.device.device import Device
from ...core.errors import DefsenseError, StorageError
from ...core.storage.files import digest
from ...store.fields import INDEX, field_path, load_index, save_index
from .build import build_lock
from .load_cases import NOT_MIXED, list_loadings
from .stage_files import complete_key, file_sizes, save_stage_record
from .stages import STAGES, plain, stage_keys

_SIMULATE = next(stage for stage in STAGES if stage.name == "simulate")


def is_rename(before: Device, after: Device) -> bool:
    """Return whether the name of one pose is all that a simulation depends on and has changed."""
    return bool(_renamed_states(before, after))


def carry_over_rename(before: Device, after: Device) -> bool:
    """Rename a pose in the simulation of a device's build, if nothing else has changed.

    Later stages, which also contain the name, become outdated.

    Args:
        before: The device that the build belongs to.
        after: The device as it is now.

    Returns:
        Whether the simulation belongs to `after` now.

    Raises:
        StorageError: A build is running.
    """
    folder = after.source / "build"
    names = _renamed_states(before, after)
    if not names or not (folder / INDEX).exists():
        return False
    try:
        with build_lock(after):
            former, key = stage_keys(before, folder), stage_keys(after, folder)
            is_valid = complete_key(folder, _SIMULATE) == former[_SIMULATE.name]
            if not is_valid or former["mesh"] != key["mesh"]:
                return False
            index = load_index(folder)
            pose = dict((a.name, b.name) for a, b in zip(before.poses, after.poses, strict=True))
            states = tuple(
                replace(s, state=names[s.state], weights=_renamed(s.weights, pose))
                for s in index.states
            )
            for old, new in names.items():
                if old != new and field_path(folder, old).exists():
                    field_path(folder, old).replace(field_path(folder, new))
            warnings = tuple(_in_warning(text, names, pose) for text in index.warnings)
            save_index(folder, replace(index, states=states, warnings=warnings))
            record = {"key": key[_SIMULATE.name], "files": file_sizes(folder, _SIMULATE)}
            save_stage_record(folder, _SIMULATE, record)
    except (DefsenseError, OSError, KeyError) as error:
        if isinstance(error, StorageError) and error.code == "build-running":
            raise
        return False  # files are damaged
    return True


def _renamed_states(before: Device, after: Device) -> dict[str, str]:
    """Return the new name of each state by its old one; empty if more has changed than a name."""
    if len(before.poses) != len(after.poses):
        return {}
    pose = {a.name: b.name for a, b in zip(before.poses, after.poses, strict=True)}
    if sum(old != new for old, new in pose.items()) != 1:
        return {}
    poses = tuple(replace(p, name=pose[p.name]) for p in before.poses)
    material = before.simulated_material, before.material
    present_material = after.simulated_material, after.material
    if not _are_equal((*material, poses), (*present_material, after.poses)):
        return {}
    former, present = list_loadings(before), list_loadings(after)
    expected = [replace(x, weights=_renamed(x.weights, pose)) for x in former]
    if before.states.ramp != after.states.ramp or not _are_equal(expected, present):
        return {}
    return {
        a.state(share): b.state(share)
        for a, b in zip(former, present, strict=True)
        for share in a.fractions
    }


def _are_equal(a: object, b: object) -> bool:
    return digest(plain(a)) == digest(plain(b))  # values that are NaN are equal


def _renamed(weights: Mapping[str, float], pose: Mapping[str, str]) -> dict[str, float]:
    return {pose[name]: weight for name, weight in weights.items()}


def _in_warning(text: str, states: Mapping[str, str], poses: Mapping[str, str]) -> str:
    """Return a warning with new names; names of poses may be other words in other warnings."""
    mixed, sign, rest = text.partition(NOT_MIXED)
    if sign:
        return _in_text(mixed, {**states, **poses}) + sign + _in_text(rest, states)
    return _in_text(text, states)


def _in_text(text: str, names: Mapping[str, str]) -> str:
    """Return a text with new names by the old ones, where they are words."""
    longest_first = sorted(map(re.escape, names), key=len, reverse=True)
    words = rf"(?<!\w)(?:{'|'.join(longest_first)})(?!\w)"
    return re.sub(words, lambda match: names[match[0]], text)
