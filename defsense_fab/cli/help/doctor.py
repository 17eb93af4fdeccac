"""Command `defsense doctor`: check dependencies."""

from __future__ import annotations

import shutil
import sys
import textwrap
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from ...workflow.doctor.doctor import DEFAULT_OPTIONS, DoctorOptions
from ..app import command
from ..exit_codes import DONE, REFUSED
from ..output import OutputOptions, print_json, standard_output

if TYPE_CHECKING:
    from ...workflow.doctor.checks import Finding

_INDENT = 12
_NO_OUTPUT = OutputOptions()

doctor = command("doctor", "defsense doctor", "defsense doctor --pictures pictures")


@doctor.default
def _doctor(
    *,
    options: Annotated[DoctorOptions, Parameter(name="*", consume_multiple=True)] = DEFAULT_OPTIONS,
    output: OutputOptions = _NO_OUTPUT,
) -> int:
    """Test everything that this program needs.

    The tests are: Python and libraries, OpenGL, CAD kernels, solver, cameras, read-out boards,
    slicer, memory, disk, cache, MIDI and gamepads. Each is good, missing (with the command that
    installs it), or not needed (with the task that would need it). With --verbose, good libraries
    are listed one by one. Read-out boards restart when they are tested.

    The exit code is 0 if devices can be built here, else 2.
    """
    from ...workflow.doctor.doctor import examine

    findings: list[Finding] = []
    is_good = True  # also if the reader of the output closed it early
    with standard_output():
        for finding in examine(options):
            findings.append(finding)
            if not output.json and (output.verbose or not _is_good_library(finding)):
                sys.stdout.write(_format_finding(finding))
                sys.stdout.flush()
        is_good = all(f.status != "missing" for f in findings)
        if output.json:
            rows = [{**asdict(f), "status": f.status} for f in findings]
            print_json({"good": is_good, "findings": rows})
        else:
            sys.stdout.write(_summarize(findings, output.verbose, is_good))
    return DONE if is_good else REFUSED


def _is_good_library(finding: Finding) -> bool:
    return finding.check == "libraries" and finding.is_good


def _format_finding(finding: Finding) -> str:
    """Return a finding as lines that fit the terminal, with its command on a line of its own."""
    text = f"{finding.about}: {finding.message}"
    if finding.status == "not needed":
        text = f"{text.rstrip('.')}; needed for {finding.needed_for}"
    lines = textwrap.wrap(
        text,
        max(shutil.get_terminal_size().columns, 40),
        initial_indent=f"{finding.status:<{_INDENT}}",
        subsequent_indent=" " * _INDENT,
        break_on_hyphens=False,
    )
    if finding.command:
        lines.append(f"{'':{_INDENT}}run: {finding.command}")
    return "\n".join(lines) + "\n"


def _summarize(findings: list[Finding], verbose: bool, is_good: bool) -> str:
    count = sum(_is_good_library(f) for f in findings)
    libraries = f"{'good':<{_INDENT}}{count} libraries import\n" if count and not verbose else ""
    verdict = "Devices can be built here." if is_good else "Install what is missing first."
    return f"{libraries}\n{verdict}\n"
