"""Command `defsense reproduce`: repeat the experiments of the paper."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..options import add_verbose_option, check_range
from ..output import console, print_json, print_lines, progress_bars, silent_stdout, standard_output

if TYPE_CHECKING:
    from ..options import Commands


def add(commands: Commands) -> None:
    """Add `reproduce`."""
    sub = commands.add_parser(
        "reproduce",
        help="Repeat the paper's experiments and compare the numbers",
        description="Run experiments of DefSense (CHI 2016), or those of folders with an "
        "experiment.toml. Devices are built with each layout that is compared; "
        "simulated units are recorded while a hand moves them, trained and tested. One"
        " page shows the paper's numbers, ours, and why they differ. Rerun the command"
        " to resume an interrupted run.",
        examples=[
            "defsense reproduce --quick",
            "defsense reproduce bar twist-bar --units 5",
            "defsense reproduce my-device --out results",
        ],
    )
    sub.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="Examples, or folders with experiment.toml (default: all examples)",
    )
    sub.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="Set the output folder (default: reproduced, or reproduced-quick with --quick)",
    )
    sub.add_argument(
        "--quick", action="store_true", help="Run a small version of the experiments, in minutes"
    )
    sub.add_argument(
        "--units",
        type=int,
        metavar="N",
        help="Set the number of built devices per layout (default: the experiment's)",
    )
    sub.add_argument("--json", action="store_true", help="Print the results as JSON")
    add_verbose_option(sub)
    sub.set_defaults(run=_reproduce)


def _reproduce(options: argparse.Namespace) -> int:
    if options.units is not None:
        check_range("--units", options.units, 1, 100)
    from ...workflow.reproduce.experiments.examples import find_experiments
    from ...workflow.reproduce.run import PAGE, RESULTS, reproduce

    experiments = [
        e.at_size(quick=options.quick, units=options.units) for e in find_experiments(options.names)
    ]
    out = options.out or Path("reproduced-quick" if options.quick else "reproduced")
    with silent_stdout(), progress_bars(options) as progress:
        data = reproduce(experiments, out, progress)
    with standard_output():
        if options.json:
            print_json(data)
        else:
            _print_numbers(data)
            print_lines([f"Look at: {out / PAGE}", f"Numbers: {out / RESULTS}"])
    return 0


def _print_numbers(data: dict[str, Any]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from ...workflow.reproduce.results.page import format_number

    table = Table(title="Numbers of the paper and of this run", box=SIMPLE_HEAD)
    table.add_column("experiment", no_wrap=True)
    table.add_column("number")
    for name in ("paper", "this run"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("expected")
    for experiment in data["experiments"]:
        for k, row in enumerate(experiment["numbers"]):
            number = format_number(row)
            expected = f"{number['expected']}: {number['met']}" if number["expected"] else ""
            table.add_row(
                "" if k else experiment["name"],
                number["what"],
                number["paper"],
                number["ours"],
                expected,
            )
    console().print(table)
