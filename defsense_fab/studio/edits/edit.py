"""A change to a device's file: a name for people, and what it does to the document."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tomlkit import TOMLDocument


@dataclass(frozen=True)
class Edit:
    """`change` is done to the document as it is when its turn comes, so that two people may edit
    one device: it looks for what it changes by name, and raises DeviceError where that is gone. It
    may give another document in place of that one."""

    name: str
    change: Callable[[TOMLDocument], TOMLDocument | None]
