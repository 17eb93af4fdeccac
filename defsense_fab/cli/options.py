"""Options that several commands share, and checks of their values."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

from ..core.errors import DeviceError
from ..core.progress import Progress

if TYPE_CHECKING:  # argparse does not export the class that commands are added to
    from .command_parser import CommandParser

    Commands = argparse._SubParsersAction[CommandParser]

#: Context manager that shows the progress of a command with these options.
Bars = Callable[[argparse.Namespace], AbstractContextManager[Progress]]
#: Default resistance of the reference resistors of the voltage dividers, in ohm.
REFERENCE_OHM = 2200.0


def add_output_options(sub: argparse.ArgumentParser) -> None:
    """Add `--json` and `--verbose` to a parser."""
    sub.add_argument("--json", action="store_true", help="Print the result as JSON")
    add_verbose_option(sub)


def add_verbose_option(sub: argparse.ArgumentParser) -> None:
    """Add `--verbose` to a parser."""
    sub.add_argument("-v", "--verbose", action="store_true", help="Show more detail while working")


def parse_numbers(option: str, text: str, unit: str = "mm") -> list[float]:
    """Parse numbers that are separated by commas.

    Args:
        option: Option to name in an error.
        text: Value of the option.
        unit: Unit to name in an error.

    Raises:
        DeviceError: The text holds something else (`not-a-number`).
    """
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise DeviceError(
            f"{text} is not a list of numbers",
            code="not-a-number",
            where=option,
            action=f"Give numbers in {unit}, separated by commas, such as 75,100,150",
            value=text,
        ) from None


def parse_references(text: str, channels: int, option: str = "--reference") -> list[float]:
    """Parse resistances: one for all channels, or one for each.

    Args:
        text: Resistances in ohm, separated by commas.
        channels: Number of channels.
        option: Option to name in an error.

    Returns:
        One resistance per channel, in ohm.

    Raises:
        DeviceError: The count differs (`resistance-count-differs`), or a value is not a number or
            out of range.
    """
    values = parse_numbers(option, text, "ohm")
    if len(values) not in (1, channels):
        raise DeviceError(
            f"{text} has {len(values)} resistances for {channels} channels",
            code="resistance-count-differs",
            where=option,
            action=f"Give one resistance, or {channels}",
            count=len(values),
        )
    for value in values:
        check_range(option, value, 1e-3, 1e9)
    return values * channels if len(values) == 1 else values


def check_range(option: str, value: float, low: float, high: float) -> None:
    """Check that the value of an option is within limits.

    Raises:
        DeviceError: The value is outside `low` to `high`, or NaN (`out-of-range`).
    """
    if not low <= value <= high:
        raise DeviceError(
            f"{value:g} is out of range",
            code="out-of-range",
            where=option,
            action=f"Give a number from {low:g} to {high:g}",
            value=value,
        )


def parse_twin_cameras(option: str, text: str) -> tuple[int, int, str]:
    """Parse simulated cameras, such as `twin:webcam,seed=1,cameras=2`.

    Args:
        option: Option to name in an error.
        text: The words after `twin:` may come in any order; each may be left out.

    Returns:
        Seed, number of cameras, and kind of the cameras.

    Raises:
        DeviceError: A word is not known (`twin-cameras-invalid`), or there are more than 6 cameras
            (`out-of-range`).
    """
    from ..twin.filming.camera_kinds import CAMERA_KINDS, DEFAULT_CAMERA_KIND

    values, kind = {"seed": 1, "cameras": 2}, DEFAULT_CAMERA_KIND
    for part in filter(None, text.partition(":")[2].split(",")):
        name, equals, number = part.partition("=")
        if not equals and name in CAMERA_KINDS:
            kind = name
        elif equals and name in values and number.isdecimal():
            values[name] = int(number)
        else:
            raise DeviceError(
                f"{part!r} in {text} is not a setting of simulated cameras",
                code="twin-cameras-invalid",
                where=option,
                action="Give twin:KIND,seed=1,cameras=2, where KIND is one of"
                f" {', '.join(CAMERA_KINDS)}",
                value=part,
            )
    check_range(f"{option} twin:cameras", values["cameras"], 1, 6)
    return values["seed"], values["cameras"], kind
