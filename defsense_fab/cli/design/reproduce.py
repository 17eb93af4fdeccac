"""The command `defsense reproduce`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..options import within
from ..output import console, progress_bars, results, say, silent_stdout

if TYPE_CHECKING:
    from ..options import Commands


def add(commands: Commands) -> None:
    """`reproduce`."""
    sub = commands.add_parser(
        "reproduce",
        help="the paper's experiments, with its numbers beside ours",
        description="Run experiments of DefSense (CHI 2016), or those of folders with an"
        " experiment.toml: devices are built with each of the layouts that are compared, recorded"
        " by their twins while a hand moves them, trained and tested; one page shows the paper's"
        " numbers, ours, and why they differ. A run that was stopped goes on where it was.",
        examples=[
            "defsense reproduce --quick",
            "defsense reproduce bar twist-bar --units 5",
            "defsense reproduce my-device --out results",
        ],
    )
    sub.add_argument("names", nargs="*", metavar="NAME",
                     help="examples, or folders with experiment.toml (all examples)")  # fmt: skip
    sub.add_argument("--out", type=Path, metavar="DIR",
                     help="where to write (reproduced, with --quick reproduced-quick)")  # fmt: skip
    sub.add_argument("--quick", action="store_true",
                     help="the same at a small size, in minutes")  # fmt: skip
    sub.add_argument("--units", type=int, metavar="N",
                     help="built devices of each layout (as the experiment says)")  # fmt: skip
    sub.add_argument("--json", action="store_true", help="print the results as JSON")
    sub.add_argument("-v", "--verbose", action="store_true", help="say more while working")
    sub.set_defaults(run=_reproduce)


def _reproduce(options: argparse.Namespace) -> int:
    if options.units is not None:
        within("--units", options.units, 1, 100)
    from ...workflow.reproduce.experiments.examples import find_experiments
    from ...workflow.reproduce.run import PAGE, RESULTS, reproduce

    found = find_experiments(options.names)
    sized = [e.at_size(quick=options.quick, units=options.units) for e in found]
    out = options.out or Path("reproduced-quick" if options.quick else "reproduced")
    with silent_stdout(), progress_bars(options) as progress:
        data = reproduce(sized, out, progress)
    with results():
        if options.json:
            sys.stdout.write(json.dumps(data, indent=1) + "\n")
        else:
            _show(data)
            say([f"Look at: {out / PAGE}", f"Numbers: {out / RESULTS}"])
    return 0


def _show(data: dict[str, Any]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from ...workflow.reproduce.results.page import number_words

    table = Table(title="the paper's numbers and ours", box=SIMPLE_HEAD)
    table.add_column("experiment", no_wrap=True)
    table.add_column("number")
    for name in ("paper", "here"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("expected")
    for e in data["experiments"]:
        for k, row in enumerate(e["numbers"]):
            n = number_words(row)
            expected = f"{n['expected']}: {n['met']}" if n["expected"] else ""
            table.add_row("" if k else e["name"], n["what"], n["paper"], n["ours"], expected)
    console().print(table)
