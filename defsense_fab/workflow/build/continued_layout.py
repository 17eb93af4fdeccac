"""Continue from the layout of an earlier build, if an edit leaves most of it valid.

A search for cords takes most of a build. After a change of the fabrication, or of the material's
stiffness without loads, the layout stays if it still keeps all limits; after a change of a drawn
cord it is improved from where it is. After any other change, and with `defsense build --search`,
the cords are searched for again. This includes changes of the poses: a layout that was improved for
them had three times the error of a new one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...core.device.device import Device, Sensor
from ...core.errors import DefsenseError
from ...core.storage.files import digest
from ...store.layout import load_layout
from .stage_files import complete_key, load_state
from .stages import STAGES, layout_parts, plain

ASPECTS = "aspects"
_OPTIMIZE = next(s for s in STAGES if s.name == "optimize")
_FREE = frozenset({"path", "plane"})  # of proposed cords


@dataclass(frozen=True)
class EarlierLayout:
    """The layout of an earlier build of the same states, with the same cords, limits aside.

    Attributes:
        starts: Layouts to improve: its cords, those whose drawing has changed as they are drawn
            now; and its cords as they are, if those are free in path and plane.
        decoder: Name of its decoder.
        is_current: Whether only the fabrication or the material's stiffness has changed since.
    """

    starts: tuple[tuple[Sensor, ...], ...]
    decoder: str
    is_current: bool


def layout_aspects(device: Device, keys: Mapping[str, str]) -> dict[str, Any]:
    """Return what a layout depends on, hashed in groups, as `state.json` records it.

    Args:
        device: The device.
        keys: Keys of its stages.
    """
    design, fabrication = layout_parts(device)
    return {
        "mesh": keys["mesh"],
        "states": keys["simulate"],
        "design": digest(design),
        "fabrication": digest(fabrication),
        "cords": {s.name: digest(plain(s)) for s in device.sensors},
    }


def find_earlier_layout(
    device: Device, keys: Mapping[str, str], folders: Sequence[Path]
) -> EarlierLayout | None:
    """Return the layout of the first of some builds that this one can continue from.

    Args:
        device: The device.
        keys: Keys of its stages.
        folders: Folders of earlier builds.

    Returns:
        The layout; None if there is none.
    """
    now = layout_aspects(device, keys)
    for folder in folders:
        then = load_state(folder).get(_OPTIMIZE.name, {}).get(ASPECTS)
        if then is None or complete_key(folder, _OPTIMIZE) is None:
            continue
        if any(then[name] != now[name] for name in ("mesh", "states", "design")):
            continue
        if then["cords"].keys() != now["cords"].keys():
            continue
        try:
            layout = load_layout(folder)
        except DefsenseError:
            continue
        drawn = {s.name: s for s in device.sensors}
        changed = {n for n, key in now["cords"].items() if key != then["cords"][n]}
        cords = tuple(
            replace(r.sensor(), free=drawn[r.name].free if r.name in drawn else _FREE)
            for r in layout.sensors
        )
        starts = [tuple(drawn[s.name] if s.name in changed else s for s in cords)]
        if changed and all(drawn[name].free == _FREE for name in changed):
            starts.append(cords)
        return EarlierLayout(tuple(starts), layout.prediction.decoder, not changed)
    return None
