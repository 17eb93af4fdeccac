"""Questions that `defsense new` asks in a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

from ...core.errors import DefsenseError
from ...workflow.starts.options import (
    DEFAULT_PROCESS,
    END_POSES,
    EXAMPLES,
    MODES,
    UNIT_WORDS,
    NewOptions,
    check_poses,
    check_row,
    parse_unit,
)
from ..output import print_lines

if TYPE_CHECKING:
    from ...workflow.starts.body_file import BodyFile

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
    return _choose(
        "Which body? Choose an example, or enter the path of a file: a script (.py), STEP, or a"
        " mesh (STL, OBJ, PLY, 3MF, GLB).",
        [*EXAMPLES.items()],
        "bar",
    )


def ask_choices(body: BodyFile, options: NewOptions) -> tuple[BodyFile, NewOptions]:
    """Ask for the unit if it is doubtful, and for the poses and the cord if they are not given.

    Returns:
        The body, scaled if a size was the answer, and the options with the answers and with
        defaults that fit the body.

    Raises:
        DefsenseError: A given option does not fit the body.
    """
    from ...workflow.starts.body_file import choose_unit, scale_to_size
    from ...workflow.starts.first_device import check_room, fill_options, first_fitting_cord

    process = options.process or DEFAULT_PROCESS

    def check_answer(text: str) -> tuple[BodyFile, NewOptions]:
        answer = _parse_unit_or_size(text)
        filled = replace(options, **answer)
        scaled = scale_to_size(body, filled.size)
        first_fitting_cord(scaled, choose_unit(scaled, filled.units), process)
        return scaled, replace(filled, size=None)

    if options.units is None and body.is_doubtful:
        unscaled = body
        body, options = ask_until_valid(lambda: ask_unit(unscaled), check_answer)
    unit = choose_unit(body, options.units)

    def check_cord(text: str) -> str:
        check_room(body, unit, check_row("cord", text), process)
        return text

    cord = first_fitting_cord(body, unit, process)
    if options.cord is not None:
        cord = check_cord(options.cord)
    filled = fill_options(body, replace(options, cord=cord))
    if not options.poses:
        poses = ask_until_valid(lambda: ask_poses(filled.poses), _parse_poses)
        filled = replace(filled, poses=poses)
    if options.cord is None:
        filled = replace(filled, cord=ask_until_valid(lambda: ask_cord(cord), check_cord))
    return body, filled


def _parse_unit_or_size(text: str) -> dict[str, Any]:
    """Return the option that an answer sets: the size if it is a number, or else the unit."""
    try:
        return {"size": float(text)}
    except ValueError:
        return {"units": parse_unit(text)}


def ask_unit(body: BodyFile) -> str:
    """Ask for the unit of a mesh whose size is unusual for a device in mm."""
    unit = "this correct" if body.unit == body.format_unit else f"it in {UNIT_WORDS[body.unit]}"
    size = body.format_size(body.format_unit)
    return _choose(
        f"In {UNIT_WORDS[body.format_unit]} the body would be {size}: is {unit}?"
        " Choose a unit, or enter the longest side in mm, such as 170.",
        [(unit, f"{words}: {body.format_size(unit)}") for unit, words in UNIT_WORDS.items()],
        body.unit,
    )


def ask_poses(default: Sequence[str]) -> str:
    """Ask for the poses: `modes`, or names separated by commas."""
    return _choose(
        "Which poses should the device sense? It is held at one end of its length and moved at the"
        " other. Separate several by commas; modes derives them from the body's natural modes, for"
        " bodies with limbs or of irregular shape.",
        [*END_POSES.items(), (MODES, "bends, twists and stretches that need the smallest force")],
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


def _parse_poses(text: str) -> tuple[str, ...]:
    """Parse the names of poses, separated by commas."""
    return check_poses(tuple(word.strip() for word in text.split(",") if word.strip()))


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
