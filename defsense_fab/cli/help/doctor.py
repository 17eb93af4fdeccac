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
from ..options import check_range
from ..output import standard_output

if TYPE_CHECKING:
    from ...workflow.doctor.checks import Finding
    from ..options import Commands

_INDENT = 12
_TIMEOUT = 60.0  # s


def add(commands: Commands) -> None:
    """`doctor`."""
    sub = commands.add_parser(
        "doctor",
        help="Check dependencies and show how to install missing ones",
        description="Test everything that this program needs: Python and libraries, OpenGL, CAD "
        "kernels, solver, cameras, read-out boards, slicer, disk, cache, MIDI and "
        "gamepads. Each is good, missing (with the command that installs it), or not "
        "needed (with the task that would need it). The exit code is 0 if devices can "
        "be built here, else 2. Read-out boards restart when they are tested.",
        examples=["defsense doctor", "defsense doctor --pictures pictures"],
    )
    sub.add_argument(
        "--pictures",
        type=Path,
        metavar="DIR",
        help="Write a picture from each camera to this folder",
    )
    sub.add_argument(
        "--port",
        nargs="+",
        default=[],
        metavar="PORT",
        help="Test these ports too, if the system does not list them",
    )
    sub.add_argument(
        "--timeout",
        type=float,
        default=_TIMEOUT,
        metavar="S",
        help=f"Set the time limit of a single check in s (default: {_TIMEOUT:g})",
    )
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="List good libraries one by one")
    sub.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from ...workflow.doctor.doctor import examine

    check_range("--timeout", options.timeout, 0.1, 3600)
    found: list[Finding] = []
    good = True  # as far as a reader of the output stayed to hear
    with standard_output():
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
