"""What the words and numbers of all commands go through, and how commands print."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from ..core.errors import DeviceError

if TYPE_CHECKING:
    from rich.console import Console

REFERENCE = 2200.0  # ohm, of the dividers


def numbers(option: str, text: str, unit: str = "mm") -> list[float]:
    """Numbers with commas between. Raises DeviceError for anything else."""
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise DeviceError(
            f"{option} {text}: write numbers in {unit} with commas, as in 75,100,150"
        ) from None


def console() -> Console:
    """For tables, whose reader may go (`| head`): that is told as BrokenPipeError."""
    from rich.console import Console

    out = Console()
    out.on_broken_pipe = _leave  # type: ignore[method-assign]
    return out


def _leave() -> None:
    """In place of rich's own exit with code 1."""
    raise BrokenPipeError


def say(lines: Iterable[str]) -> None:
    """Print lines as they are, for terminals of any width: brackets are no colours."""
    out = console()
    for line in lines:
        out.print(line, highlight=False, markup=False, soft_wrap=True)


def references(text: str, channels: int) -> list[float]:
    """Resistances, one for all channels or one each. Raises DeviceError for others."""
    values = numbers("--reference", text, "ohm")
    if len(values) not in (1, channels):
        raise DeviceError(f"--reference {text}: give one resistance, or {channels}")
    for value in values:
        within("--reference", value, 1e-3, 1e9)
    return values * channels if len(values) == 1 else values


def within(option: str, value: float, low: float, high: float) -> None:
    """Raises DeviceError for a number that is not in this range, or none."""
    if not low <= value <= high:
        raise DeviceError(f"{option} {value:g}: give a number from {low:g} to {high:g}")
