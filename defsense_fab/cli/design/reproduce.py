"""The command `defsense reproduce`: repeat the experiments of the paper."""

from __future__ import annotations

from typing import Annotated, Any

from cyclopts import Parameter

from ...workflow.reproduce.options import ReproduceOptions
from ..app import command
from ..output import (
    OutputOptions,
    console,
    print_json,
    print_lines,
    progress_bars,
    silent_stdout,
    standard_output,
)

_DEFAULTS = ReproduceOptions()
_NO_OUTPUT = OutputOptions()

reproduce = command(
    "reproduce",
    "defsense reproduce --quick",
    "defsense reproduce bar twist-bar --units 5",
    "defsense reproduce my-device --out results",
)


@reproduce.default
def _reproduce(
    *names: str,
    options: Annotated[ReproduceOptions, Parameter(name="*")] = _DEFAULTS,
    output: OutputOptions = _NO_OUTPUT,
) -> None:
    """Repeat the paper's experiments and compare the numbers.

    Run experiments of DefSense (CHI 2016), or those of folders with an experiment.toml. Devices are
    built with each layout that is compared; simulated units are recorded while a hand moves them,
    trained and tested. One page shows the paper's numbers, ours, and why they differ. Rerun the
    command to resume an interrupted run.

    Args:
        names: Examples, or folders with experiment.toml (default: all examples).
    """
    from ...workflow.reproduce.experiment_file import find_experiments
    from ...workflow.reproduce.run import PAGE, RESULTS
    from ...workflow.reproduce.run import reproduce as run

    experiments = find_experiments(names, options)
    with silent_stdout(), progress_bars(output) as progress:
        data = run(experiments, options.folder, progress)
    with standard_output():
        if output.json:
            print_json(data)
            return
        _print_numbers(data)
        print_lines(
            [
                f"Look at: {options.folder / PAGE}",
                f"Numbers: {options.folder / RESULTS}",
            ]
        )


def _print_numbers(data: dict[str, Any]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from ...workflow.reproduce.run import format_number

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
            name = "" if k else experiment["name"]
            table.add_row(name, number["what"], number["paper"], number["ours"], expected)
    console().print(table)
