"""List the commands by task, with the modules that add them to the parser."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Module:
    """A module of this package with a function `add`.

    Attributes:
        name: Path of the module within `defsense_fab.cli`.
        commands: Commands that `add` adds.
    """

    name: str
    commands: tuple[str, ...]


#: Modules by task, in the order of the help.
TASKS: dict[str, tuple[Module, ...]] = {
    "design and make a device": (
        Module("design.new", ("new",)),
        Module("design.build", ("build", "mesh", "simulate", "optimize", "fabricate", "report")),
        Module("design.modes", ("modes",)),
        Module("design.study", ("study",)),
        Module("design.studio", ("studio",)),
    ),
    "calibrate": (
        Module("calibrate.calibrate", ("calibrate",)),
        Module("train.recalibrate", ("recalibrate",)),
    ),
    "record and train": (
        Module("capture.capture", ("capture",)),
        Module("train.twin", ("twin",)),
        Module("train.dataset", ("dataset",)),
        Module("train.train", ("train",)),
        Module("train.evaluate", ("evaluate",)),
    ),
    "run": (
        Module("run.run", ("run",)),
        Module("design.reproduce", ("reproduce",)),
    ),
    "help": (
        Module("help.doctor", ("doctor",)),
        Module("help.licences", ("licences",)),
        Module("help.completion", ("completion",)),
    ),
}


def module_of(command: str) -> str | None:
    """Return the name of the module that adds a command, or None for an unknown command."""
    for modules in TASKS.values():
        for module in modules:
            if command in module.commands:
                return module.name
    return None
