"""The cords of all layouts that the one of `layout.json` was chosen from (`layouts.json`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from ..core.storage import typed_json
from ..core.device.build_folder import BUILD_AGAIN
from .layout import CordPath

LAYOUTS = "layouts.json"


@dataclass(frozen=True)
class WeighedCords:
    """Of each layout, in the order of `LayoutRecord.weighed`, its cords as they are drawn."""

    SCHEMA: ClassVar[int] = 1

    layouts: tuple[tuple[CordPath, ...], ...]


def save_weighed(folder: Path, record: WeighedCords) -> None:
    """Into a build's folder. Raises StorageError."""
    typed_json.save(folder / LAYOUTS, record)


def load_weighed(folder: Path) -> WeighedCords:
    """From a build's folder. Raises StorageError; builds of versions before this have none."""
    return typed_json.load(folder / LAYOUTS, WeighedCords, BUILD_AGAIN)
