"""The command `defsense licences`."""

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
    """`licences`."""
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

    found = installed_licences()
    with standard_output():
        if options.json:
            print_json([asdict(f) for f in found])
            return 0
        wide = max((len(f.name) for f in found), default=0)
        long = max((len(f.version) for f in found), default=0)
        width = max(shutil.get_terminal_size().columns, wide + long + 24)
        for f in found:
            lead = f"{f.name:<{wide}}  {f.version:<{long}}  "
            lines = textwrap.wrap(f.licence, width - len(lead), break_on_hyphens=False)
            sys.stdout.write(lead + f"\n{'':{len(lead)}}".join(lines) + "\n")
    return 0
