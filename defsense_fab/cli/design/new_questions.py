"""What `defsense new` asks in a terminal, and which answers it takes."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

from ...core.errors import DefsenseError, DeviceError
from ..output import print_lines

if TYPE_CHECKING:
    from ...workflow.starts.dropped_body import DroppedBody

T = TypeVar("T")


def answered(ask: Callable[[], str], check: Callable[[str], T]) -> T:
    """What `check` makes of an answer; asked again, with the reason, where it raises."""
    while True:
        try:
            return check(ask())
        except DefsenseError as error:
            print_lines([f"  {error}"])


def ask_body() -> str:
    """The name of a device of the package, or a file."""
    from ...workflow.starts.starting_devices import STARTING_DEVICES

    rows = [(start.name, start.about) for start in STARTING_DEVICES]
    return _choose(
        "Which body? Choose one of these, or type the path of your own file: a script (.py), STEP,"
        " or a mesh (STL, OBJ, PLY, 3MF, GLB).",
        rows,
        "bar",
    )


def ask_unit(found: DroppedBody) -> str:
    """The unit of a mesh whose size is not that of a device in mm."""
    from ...workflow.starts.units import UNIT_WORDS

    unit = "so large" if found.unit == found.format_unit else f"in {UNIT_WORDS[found.unit]}"
    size = found.format_size(found.format_unit)
    return _choose(
        f"In {UNIT_WORDS[found.format_unit]} the body would be {size}: is it {unit}?",
        [(unit, f"{words}: {found.format_size(unit)}") for unit, words in UNIT_WORDS.items()],
        found.unit,
    )


def ask_poses(usual: Sequence[str]) -> str:
    """`modes`, or names of poses with commas."""
    from ...workflow.starts.body_ends import END_POSES

    return _choose(
        "Which poses is it to sense? It is held at one end of its length and moved at the other."
        " Give several with commas; modes finds them by the body's natural modes, for bodies with"
        " limbs or a shape of their own.",
        [*END_POSES.items(), ("modes", "bends, twists and stretches that cost the least force")],
        ",".join(usual),
        several=True,
    )


def ask_cord(usual: str) -> str:
    """A row of cords.csv; `usual` for no answer."""
    from ...core.storage.package_data import read_rows

    rows = [
        (
            name,
            f"{row['diameter']} mm thick, {row['ohm_per_mm']} ohm per mm, takes"
            f" {100 * float(row['max_strain']):g} % of stretch",
        )
        for name, row in read_rows("cords.csv").items()
    ]
    return _choose("Which cord?", rows, usual)


def pose_names(text: str) -> tuple[str, ...]:
    """Raises DeviceError for poses that there are not."""
    from ...workflow.starts.first_device import check_poses

    names = tuple(word.strip().replace("-", "_") for word in text.split(",") if word.strip())
    check_poses(names)
    return names


def cord_row(text: str) -> str:
    """Raises DeviceError for a cord that there is not."""
    return _row("cords.csv", "cord", text)


def cords() -> list[str]:
    """Those that there are."""
    from ...core.storage.package_data import read_rows

    return list(read_rows("cords.csv"))


def material_row(text: str) -> str:
    """Raises DeviceError for a material that there is not."""
    return _row("materials.csv", "material", text)


def process_row(text: str) -> str:
    """Raises DeviceError for a process that there is not."""
    return _row("printers.csv", "process", text)


def _row(table: str, what: str, text: str) -> str:
    from ...core.storage.package_data import read_rows

    rows = read_rows(table)
    if text not in rows:
        raise DeviceError(f"{what} {text}: there is {', '.join(rows)}")
    return text


def _choose(
    question: str, rows: Sequence[tuple[str, str]], usual: str, several: bool = False
) -> str:
    """An answer, or `usual` for none; a row may be given by its number, `several` with commas."""
    width = max(len(name) for name, _ in rows)
    lines = [f"  {k}  {name:<{width}}  {about}" for k, (name, about) in enumerate(rows, 1)]
    print_lines(["", question, *lines])
    sys.stdout.write(f"[{usual}] ")
    sys.stdout.flush()
    line = sys.stdin.readline()
    if not line:
        raise KeyboardInterrupt  # the terminal was closed
    answer = line.strip()
    words = [word.strip() for word in answer.split(",")] if several else [answer]
    numbered = {str(k): name for k, (name, _) in enumerate(rows, 1)}
    return ",".join(numbered.get(word, word) for word in words if word) or usual
