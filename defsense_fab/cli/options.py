"""Checks that the words and numbers of all commands go through."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from ..core.errors import DeviceError
from ..core.progress import Progress

if TYPE_CHECKING:  # argparse keeps the name of what commands are added to for itself
    from .command_parser import CommandParser

    Commands = argparse._SubParsersAction[CommandParser]

#: Shows the progress of a command with these options.
Bars = Callable[[argparse.Namespace], AbstractContextManager[Progress]]
REFERENCE = 2200.0  # ohm, of the dividers


def numbers(option: str, text: str, unit: str = "mm") -> list[float]:
    """Numbers with commas between. Raises DeviceError for anything else."""
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise DeviceError(
            f"{option} {text}: write numbers in {unit} with commas, as in 75,100,150"
        ) from None


def references(text: str, channels: int, option: str = "--reference") -> list[float]:
    """Resistances, one for all channels or one each. Raises DeviceError for others."""
    values = numbers(option, text, "ohm")
    if len(values) not in (1, channels):
        raise DeviceError(f"{option} {text}: give one resistance, or {channels}")
    for value in values:
        within(option, value, 1e-3, 1e9)
    return values * channels if len(values) == 1 else values


def within(option: str, value: float, low: float, high: float) -> None:
    """Raises DeviceError for a number that is not in this range, or none."""
    if not low <= value <= high:
        raise DeviceError(f"{option} {value:g}: give a number from {low:g} to {high:g}")


def twin_values(option: str, word: str) -> tuple[int, int, str]:
    """Seed, number and kind of the cameras of twin:webcam,seed=1,cameras=2, each or none. Raises
    DeviceError."""
    from ..twin.filming.camera_kinds import CAMERA_KINDS, DEFAULT_CAMERA_KIND

    values, kind = {"seed": 1, "cameras": 2}, DEFAULT_CAMERA_KIND
    for part in filter(None, word.partition(":")[2].split(",")):
        name, equals, number = part.partition("=")
        if not equals and name in CAMERA_KINDS:
            kind = name
        elif equals and name in values and number.isdecimal():
            values[name] = int(number)
        else:
            raise DeviceError(
                f"{option} {word}: write twin:webcam,seed=1,cameras=2, each or none; the kinds of"
                f" cameras are {', '.join(CAMERA_KINDS)}"
            )
    within(f"{option} twin:cameras", values["cameras"], 1, 6)
    return values["seed"], values["cameras"], kind
