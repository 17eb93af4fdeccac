"""The command `defsense licences`."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import textwrap
from dataclasses import asdict
from typing import TYPE_CHECKING

from ..output import results

if TYPE_CHECKING:
    from ..options import Commands


def add(commands: Commands) -> None:
    """`licences`."""
    sub = commands.add_parser(
        "licences",
        help="under which licences the libraries are that are installed",
        description="The licences of all installed libraries that this program needs, and that"
        " those need, as their own metadata has them.",
        examples=["defsense licences", "defsense licences --json"],
    )
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")
    sub.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    from ...workflow.doctor.licences import installed_licences

    found = installed_licences()
    with results():
        if options.json:
            sys.stdout.write(json.dumps([asdict(f) for f in found], indent=1) + "\n")
            return 0
        wide = max((len(f.name) for f in found), default=0)
        long = max((len(f.version) for f in found), default=0)
        width = max(shutil.get_terminal_size().columns, wide + long + 24)
        for f in found:
            lead = f"{f.name:<{wide}}  {f.version:<{long}}  "
            lines = textwrap.wrap(f.licence, width - len(lead), break_on_hyphens=False)
            sys.stdout.write(lead + f"\n{'':{len(lead)}}".join(lines) + "\n")
    return 0
