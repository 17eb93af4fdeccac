"""Questions that `defsense new` shows in a terminal, and checks of the answers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

from ...core.errors import DefsenseError, DeviceError
from ..output import print_lines

if TYPE_CHECKING:
    from ...workflow.starts.dropped_body import DroppedBody

T = TypeVar("T")


def ask_until_valid(ask: Callable[[], str], check: Callable[[str], T]) -> T:
    """Ask until an answer is valid.

    Args:
        ask: Shows the question and returns the answer.
        check: Converts the answer; the question is repeated with the reason if it raises a
            DefsenseError.
    """
    while True:
        try:
            return check(ask())
        except DefsenseError as error:
            print_lines([f"  {error}"])


def ask_body() -> str:
    """Ask for the body: the name of an example of the package, or a file."""
    from ...workflow.starts.starting_devices import STARTING_DEVICES

    rows = [(start.name, start.about) for start in STARTING_DEVICES]
    return _choose(
        "Which body? Choose an example, or enter the path of a file: a script (.py), STEP, or a"
        " mesh (STL, OBJ, PLY, 3MF, GLB).",
        rows,
        "bar",
    )


def ask_unit(found: DroppedBody) -> str:
    """Ask for the unit of a mesh whose size is unusual for a device in mm."""
    from ...workflow.starts.units import UNIT_WORDS

    unit = "this correct" if found.unit == found.format_unit else f"in {UNIT_WORDS[found.unit]}"
    size = found.format_size(found.format_unit)
    return _choose(
        f"In {UNIT_WORDS[found.format_unit]} the body would be {size}: is {unit}?",
        [(unit, f"{words}: {found.format_size(unit)}") for unit, words in UNIT_WORDS.items()],
        found.unit,
    )


def ask_poses(default: Sequence[str]) -> str:
    """Ask for the poses: `modes`, or names separated by commas."""
    from ...workflow.starts.body_ends import END_POSES

    return _choose(
        "Which poses should the device sense? It is held at one end of its length and moved at the"
        " other. Separate several by commas; modes derives them from the body's natural modes, for"
        " bodies with limbs or of irregular shape.",
        [*END_POSES.items(), ("modes", "bends, twists and stretches that need the smallest force")],
        ",".join(default),
        several=True,
    )


def ask_cord(default: str) -> str:
    """Ask for the cord, a row of cords.csv; `default` for an empty answer."""
    from ...core.storage.package_data import read_rows

    rows = [
        (
            name,
            f"{row['diameter']} mm thick, {row['ohm_per_mm']} ohm per mm, up to"
            f" {100 * float(row['max_strain']):g} % strain",
        )
        for name, row in read_rows("cords.csv").items()
    ]
    return _choose("Which cord?", rows, default)


def parse_poses(text: str) -> tuple[str, ...]:
    """Parse the names of poses, separated by commas.

    Raises:
        DeviceError: A pose does not exist.
    """
    from ...workflow.starts.first_device import check_poses

    names = tuple(word.strip().replace("-", "_") for word in text.split(",") if word.strip())
    check_poses(names)
    return names


def check_cord(text: str) -> str:
    """Return the name of a cord, or raise DeviceError (`unknown-cord`)."""
    return _check_row("cords.csv", "cord", text)


def cord_names() -> list[str]:
    """Return the names of all cords."""
    from ...core.storage.package_data import read_rows

    return list(read_rows("cords.csv"))


def check_material(text: str) -> str:
    """Return the name of a material, or raise DeviceError (`unknown-material`)."""
    return _check_row("materials.csv", "material", text)


def check_process(text: str) -> str:
    """Return the name of a process, or raise DeviceError (`unknown-process`)."""
    return _check_row("printers.csv", "process", text)


def _check_row(table: str, kind: str, text: str) -> str:
    """Return the name of a row of a table of the package, after checking that it exists."""
    from ...core.storage.package_data import read_rows

    rows = read_rows(table)
    if text not in rows:
        raise DeviceError(
            f"{text} is not a {kind}",
            code=f"unknown-{kind}",
            where=kind,
            action=f"Choose one of {', '.join(rows)}",
            value=text,
        )
    return text


def _choose(
    question: str, choices: Sequence[tuple[str, str]], default: str, several: bool = False
) -> str:
    """Show numbered choices, and return the answer, or `default` if it is empty.

    A choice may be given by its name or number; `several` are separated by commas.
    """
    width = max(len(name) for name, _ in choices)
    lines = [f"  {k}  {name:<{width}}  {about}" for k, (name, about) in enumerate(choices, 1)]
    print_lines(["", question, *lines])
    sys.stdout.write(f"[{default}] ")
    sys.stdout.flush()
    line = sys.stdin.readline()
    if not line:
        raise KeyboardInterrupt  # the terminal was closed
    answer = line.strip()
    words = [word.strip() for word in answer.split(",")] if several else [answer]
    numbered = {str(k): name for k, (name, _) in enumerate(choices, 1)}
    return ",".join(numbered.get(word, word) for word in words if word) or default
