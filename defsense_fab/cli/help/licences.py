"""Command `defsense licences`: list the licenses of libraries."""

from __future__ import annotations

import shutil
import sys
import textwrap
from dataclasses import asdict

from ..app import command
from ..output import OutputOptions, print_json, standard_output

_NO_OUTPUT = OutputOptions()

licences = command("licences", "defsense licences", "defsense licences --json")


@licences.default
def _licences(*, output: OutputOptions = _NO_OUTPUT) -> None:
    """List the licenses of libraries.

    These are all installed libraries that this program needs directly or indirectly, with the
    licenses that their metadata state, and the libraries in the compiled firmware of boards.
    """
    from ...workflow.doctor.libraries import installed_licences

    rows = installed_licences()
    with standard_output():
        if output.json:
            print_json([asdict(row) for row in rows])
            return
        name_width = max((len(row.name) for row in rows), default=0)
        version_width = max((len(row.version) for row in rows), default=0)
        width = max(shutil.get_terminal_size().columns, name_width + version_width + 24)
        for row in rows:
            lead = f"{row.name:<{name_width}}  {row.version:<{version_width}}  "
            lines = textwrap.wrap(row.licence, width - len(lead), break_on_hyphens=False)
            sys.stdout.write(lead + f"\n{'':{len(lead)}}".join(lines) + "\n")
