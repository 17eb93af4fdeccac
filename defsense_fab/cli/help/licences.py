"""Command `defsense licences`: list the licenses of libraries."""

from __future__ import annotations

import argparse
import shutil
import sys
import textwrap
from dataclasses import asdict
from typing import TYPE_CHECKING

from ..options import add_output_options
from ..output import print_json, standard_output

if TYPE_CHECKING:
    from ..options import Commands


def add(commands: Commands) -> None:
    """Add `licences`."""
    sub = commands.add_parser(
        "licences",
        help="List the licenses of the installed libraries",
        description="List the licenses of all installed libraries that this program needs directly"
        " or indirectly, from their metadata.",
        examples=["defsense licences", "defsense licences --json"],
    )
    add_output_options(sub)
    sub.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from ...workflow.doctor.libraries import installed_licences

    licences = installed_licences()
    with standard_output():
        if options.json:
            print_json([asdict(f) for f in licences])
            return 0
        name_width = max((len(f.name) for f in licences), default=0)
        version_width = max((len(f.version) for f in licences), default=0)
        width = max(shutil.get_terminal_size().columns, name_width + version_width + 24)
        for f in licences:
            lead = f"{f.name:<{name_width}}  {f.version:<{version_width}}  "
            lines = textwrap.wrap(f.licence, width - len(lead), break_on_hyphens=False)
            sys.stdout.write(lead + f"\n{'':{len(lead)}}".join(lines) + "\n")
    return 0
