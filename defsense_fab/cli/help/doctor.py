"""The command `defsense doctor`."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import textwrap
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from ..exit_codes import DONE, REFUSED
from ..options import within
from ..output import results

if TYPE_CHECKING:
    from ...workflow.doctor.finding import Finding
    from ..options import Commands

_INDENT = 12
_TIMEOUT = 60.0  # s


def add(commands: Commands) -> None:
    """`doctor`."""
    sub = commands.add_parser(
        "doctor",
        help="what this machine has of what is needed, and what to type where it lacks it",
        description="Try everything that this program needs of the machine: Python and libraries,"
        " OpenGL, CAD kernels, solver, cameras, read-out boards, slicer, disk, cache, MIDI and"
        " gamepads. Each is good, missing (with what to type), or not needed unless you do what is"
        " told. Ends with 0 where devices can be built here, else with 2. Read-out boards restart"
        " when they are asked.",
        examples=["defsense doctor", "defsense doctor --pictures pictures"],
    )
    sub.add_argument("--pictures", type=Path, metavar="DIR",
                     help="write a picture of each camera into this folder")  # fmt: skip
    sub.add_argument("--port", nargs="+", default=[], metavar="PORT",
                     help="ask these ports, too, which the system does not list")  # fmt: skip
    sub.add_argument("--timeout", type=float, default=_TIMEOUT, metavar="S",
                     help=f"s that a single check may last ({_TIMEOUT:g})")  # fmt: skip
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="tell good libraries one by one")
    sub.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from ...workflow.doctor.doctor import examine

    within("--timeout", options.timeout, 0.1, 3600)
    found: list[Finding] = []
    good = True  # as far as a reader of the output stayed to hear
    with results():
        for finding in examine(options.timeout, options.pictures, options.port):
            found.append(finding)
            if not options.json and (options.verbose or not _summed(finding)):
                sys.stdout.write(told(finding))
                sys.stdout.flush()
        good = all(f.status == "good" for f in found if f.core)
        if options.json:
            sys.stdout.write(
                json.dumps({"good": good, "findings": [asdict(f) for f in found]}, indent=1) + "\n"
            )
        else:
            sys.stdout.write(_sum(found, options.verbose, good))
    return DONE if good else REFUSED


def _summed(finding: Finding) -> bool:
    return finding.check == "libraries" and finding.status == "good"


def told(finding: Finding) -> str:
    """Its lines, as wide as the terminal at most; what is to be typed is on a line of its own."""
    width = max(shutil.get_terminal_size().columns, 40)
    text = f"{finding.about}: {finding.told}"
    if finding.status == "not needed":
        text += f"; needed for {finding.needed_for}"
    lines = textwrap.wrap(
        text, width, initial_indent=f"{finding.status:<{_INDENT}}", subsequent_indent=" " * _INDENT,
        break_on_hyphens=False,
    )  # fmt: skip
    if finding.command:
        lines.append(f"{'':{_INDENT}}type: {finding.command}")
    return "\n".join(lines) + "\n"


def _sum(found: Iterable[Finding], verbose: bool, good: bool) -> str:
    libraries = [f for f in found if _summed(f)]
    line = f"{'good':<{_INDENT}}{len(libraries)} libraries import\n"
    line = line if libraries and not verbose else ""
    return line + ("\nDevices can be built here.\n" if good else
                   "\nWhat is missing has to be mended first.\n")  # fmt: skip
