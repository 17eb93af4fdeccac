"""Command `defsense doctor`: check dependencies."""

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
_TIMEOUT_S = 60.0


def add(commands: Commands) -> None:
    """Add `doctor`."""
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
        default=_TIMEOUT_S,
        metavar="S",
        help=f"Set the time limit of a single check in s (default: {_TIMEOUT_S:g})",
    )
    sub.add_argument("--json", action="store_true", help="Print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="List good libraries one by one")
    sub.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from ...workflow.doctor.doctor import examine

    check_range("--timeout", options.timeout, 0.1, 3600)
    findings: list[Finding] = []
    is_good = True  # also if the reader of the output closed it early
    with standard_output():
        for finding in examine(options.timeout, options.pictures, options.port):
            findings.append(finding)
            if not options.json and (options.verbose or not _is_good_library(finding)):
                sys.stdout.write(format_finding(finding))
                sys.stdout.flush()
        is_good = all(f.status == "good" for f in findings if f.core)
        if options.json:
            sys.stdout.write(
                json.dumps({"good": is_good, "findings": [asdict(f) for f in findings]}, indent=1)
                + "\n"
            )
        else:
            sys.stdout.write(_summarize(findings, options.verbose, is_good))
    return DONE if is_good else REFUSED


def _is_good_library(finding: Finding) -> bool:
    return finding.check == "libraries" and finding.status == "good"


def format_finding(finding: Finding) -> str:
    """Return a finding as lines that fit the terminal, with its command on a line of its own."""
    width = max(shutil.get_terminal_size().columns, 40)
    text = f"{finding.about}: {finding.told}"
    if finding.status == "not needed":
        text += f"; needed for {finding.needed_for}"
    lines = textwrap.wrap(
        text, width, initial_indent=f"{finding.status:<{_INDENT}}", subsequent_indent=" " * _INDENT,
        break_on_hyphens=False,
    )  # fmt: skip
    if finding.command:
        lines.append(f"{'':{_INDENT}}run: {finding.command}")
    return "\n".join(lines) + "\n"


def _summarize(findings: Iterable[Finding], verbose: bool, is_good: bool) -> str:
    libraries = [f for f in findings if _is_good_library(f)]
    line = f"{'good':<{_INDENT}}{len(libraries)} libraries import\n"
    line = line if libraries and not verbose else ""
    return line + ("\nDevices can be built here.\n" if is_good else
                   "\nInstall what is missing first.\n")  # fmt: skip
