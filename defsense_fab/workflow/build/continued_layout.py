"""Continue from the layout of an earlier build, if an edit leaves most of it valid.

A search for cords takes most of a build. After a change of the fabrication, or of the material's
stiffness without loads, the layout stays if it still keeps all limits; after a change of a drawn
cord it is improved from where it is; with another number of parts, another layout of the same
search takes its place. After any other change, and with `defsense build --search`,
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
from ...store.layout import CordPath, LayoutRecord, WeighedCords, load_layout, load_weighed
from .stage_files import complete_key, load_state
from .stages import STAGES, layout_parts, plain

ASPECTS = "aspects"
_OPTIMIZE = next(s for s in STAGES if s.name == "optimize")
_FREE = frozenset({"path", "plane"})  # of proposed cords


@dataclass(frozen=True)
class SearchedLayouts:
    """The layouts that a search has reached.

    Attributes:
        record: The layout that was chosen, with the errors and parts of all.
        paths: Their cords as the build has stored them.
        cords: The cords of each layout, in the order of `record.weighed`.
    """

    record: LayoutRecord
    paths: WeighedCords
    cords: tuple[tuple[Sensor, ...], ...]


@dataclass(frozen=True)
class EarlierLayout:
    """The layout of an earlier build of the same states, with the same cords, limits aside.

    Attributes:
        starts: Layouts to improve: its cords, those whose drawing has changed as they are drawn
            now; and its cords as they are, if those are free in path and plane.
        decoder: Name of its decoder.
        is_current: Whether only the fabrication or the material's stiffness has changed since.
        searched: All layouts of its search, if nothing that the search depends on has changed.
    """

    starts: tuple[tuple[Sensor, ...], ...]
    decoder: str
    is_current: bool
    searched: SearchedLayouts | None = None


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
        cords = _to_sensors(layout.sensors, drawn)
        starts = [tuple(drawn[s.name] if s.name in changed else s for s in cords)]
        if changed and all(drawn[name].free == _FREE for name in changed):
            starts.append(cords)
        searched = _searched_layouts(folder, layout, drawn) if then == now else None
        return EarlierLayout(tuple(starts), layout.prediction.decoder, not changed, searched)
    return None


def _to_sensors(paths: Sequence[CordPath], drawn: Mapping[str, Sensor]) -> tuple[Sensor, ...]:
    """Return cords with the freedoms of those that are drawn; proposed ones are free."""
    return tuple(
        replace(p.sensor(), free=drawn[p.name].free if p.name in drawn else _FREE) for p in paths
    )


def _searched_layouts(
    folder: Path, layout: LayoutRecord, drawn: Mapping[str, Sensor]
) -> SearchedLayouts | None:
    """Return the layouts of a build's search; None if they are missing or damaged."""
    try:
        paths = load_weighed(folder)
    except DefsenseError:
        return None
    if len(paths.layouts) != len(layout.weighed):
        return None
    return SearchedLayouts(layout, paths, tuple(_to_sensors(p, drawn) for p in paths.layouts))
