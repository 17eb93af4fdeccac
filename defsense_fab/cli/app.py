"""The commands of `defsense` by task; the module of a command is imported when it is used."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Sequence
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from cyclopts import App, Argument, ArgumentCollection, Group, Parameter, Token

from ..core.version import __version__
from .completers import add_completer

_DESCRIPTION = (
    "Design, build and run soft objects that sense their own deformation: from a device folder to"
    " printable parts with a predicted accuracy."
)
_EPILOGUE = (
    "Exit codes: 0 success; 1 the answer is no; 2 an error, with one line that states what to do;"
    " 130 interrupted by Ctrl-C, with one line that states what is kept (docs/commands.md)."
)


class Command(App):
    """A command, or a group of commands, whose help ends with examples.

    Attributes:
        examples: Complete command lines. The help prints each on one line of its own, so that it
            can be copied from a narrow terminal.
    """

    examples: Sequence[str] = ()

    def assemble_argument_collection(self, **settings: Any) -> ArgumentCollection:
        """Return the arguments of the command, as this program shows and reads them."""
        arguments = App.assemble_argument_collection(self, **settings)
        for argument in arguments:
            add_completer(argument)
            changes = Parameter(**_changes(argument))
            argument.parameter = Parameter.combine(argument.parameter, changes)
        return arguments

    def help_print(self, tokens: Any = None, *, console: Any = None) -> None:
        """Print the help of the command that the words name, and its examples."""
        _, apps, _ = self.parse_commands(tokens)
        app = apps[-1]
        if app.default_command is not None and app is not self:
            app.help = "\n\n".join([app.help, *_further_paragraphs(app.default_command)])
        App.help_print(self, tokens, console=console)
        examples = getattr(app, "examples", ())
        if examples:
            output = console or self.console
            title = "Example" if len(examples) == 1 else "Examples"
            output.print(f"{title}:", markup=False)
            for line in examples:
                output.print(f"  {line}", markup=False, highlight=False, soft_wrap=True)
            output.print()


def _changes(argument: Argument) -> dict[str, Any]:
    """Return what this program shows and reads in another way than cyclopts."""
    parameter, default = argument.parameter, argument.field_info.default
    changes: dict[str, Any] = {}
    if parameter.help:
        changes["help"] = " ".join(parameter.help.split())
    if parameter.converter is None and _is_integer(argument.hint):
        changes["converter"] = whole_number
    if parameter.metavar is None and parameter.converter is None and argument.name.startswith("-"):
        changes["metavar"] = _placeholder(argument.hint)
    if parameter.show_default is None:
        is_empty = default is None or default is False or default in ((), "")
        changes["show_default"] = False if is_empty else _format_default
    if default is False:
        changes["negative"] = ()
    return changes


def _placeholder(hint: Any) -> str | None:
    """Return the word for a value in the help, such as `NUMBER,NUMBER`; None for other types."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType, Annotated):
        return next((word for part in parts if (word := _placeholder(part))), None)
    if origin is tuple:
        words = ["..." if part is Ellipsis else _placeholder(part) for part in parts]
        return ",".join(map(str, words)) if all(words) else None
    return {int: "N", float: "NUMBER", str: "TEXT"}.get(hint)


def _further_paragraphs(function: Callable[..., object]) -> Iterator[str]:
    """Yield the paragraphs of a docstring between its first one and its sections."""
    for paragraph in (inspect.getdoc(function) or "").split("\n\n")[1:]:
        if paragraph.partition("\n")[0].endswith(":"):
            return
        yield " ".join(paragraph.split())


def _format_default(value: Any) -> str:
    """Format a default as it is typed: `90` for 90.0, and commas between items."""
    if isinstance(value, tuple):
        return ",".join(map(_format_default, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _is_integer(hint: Any) -> bool:
    """Return whether a type is an integer, also an optional or annotated one."""
    is_wrapped = get_origin(hint) in (Union, UnionType, Annotated)
    return hint is int or (is_wrapped and any(map(_is_integer, get_args(hint))))


def whole_number(_: object, tokens: Sequence[Token]) -> int:
    """Return an integer; cyclopts rounds `1.5` to 2."""
    (token,) = tokens
    if not token.value.strip().lstrip("+-").isdecimal():
        raise ValueError(f"{token.value!r} is not a whole number")
    return int(token.value)


def command(name: str, *examples: str, **settings: Any) -> Command:
    """Return a command to which a function or further commands can be added.

    Args:
        name: The word that calls it.
        *examples: Complete command lines for its help.
        **settings: Further arguments of `cyclopts.App`.
    """
    settings = {"help_epilogue": "", "version_flags": (), **settings}
    app = Command(name=name, **settings)
    app.examples = examples
    return app


def make_app() -> Command:
    """Return the program with all commands; only the modules of used ones are imported."""
    app = command(
        "defsense",
        "defsense build fixtures/devices/bar",
        help=_DESCRIPTION,
        help_epilogue=_EPILOGUE,
        version=f"defsense-fab {__version__}",
        version_flags=("--version",),
        help_format="plaintext",  # markup takes 0.1 s to import
        suppress_keyboard_interrupt=False,
        default_parameter=Parameter(negative_iterable=(), negative_none=(), show_env_var=False),
    )
    for position, (task, commands) in enumerate(_TASKS.items()):
        group = Group(task, sort_key=position)
        for order, (name, (module, text)) in enumerate(commands.items()):
            place = module if ":" in module else f"{module}:{name}"
            app.command(f"{__package__}.{place}", name=name, help=text, group=group, sort_key=order)
    return app


#: Commands by task, in the order of the help, with their modules and descriptions. The variable in
#: the module has the name of the command unless it is given.
_TASKS: dict[str, dict[str, tuple[str, str]]] = {
    "Design and make a device": {
        "new": ("design.new", "Create a device folder to build"),
        "build": ("design.build", "Run all stages: body, mesh, poses, cords, parts, report"),
        "mesh": ("design.build", "Load the body and mesh it with tetrahedra"),
        "simulate": ("design.build", "Solve all poses, and run the stages before"),
        "optimize": ("design.build", "Route the cords, and run the stages before"),
        "fabricate": ("design.build", "Make the parts, and run the stages before"),
        "report": ("design.build", "Write the report, and run the stages before"),
        "modes": ("design.modes", "Propose poses from the deformation modes of a body"),
        "traces": ("design.traces", "Check the G-code of a device with printed traces"),
        "study": ("design.study", "Compare designs: numbers of cords, or values of device.toml"),
        "studio": ("design.studio", "Edit and watch a device in the browser"),
        "open": ("design.open:open_page", "Open the report or the assembly guide in the browser"),
    },
    "Set up the read-out board": {
        "board": ("board.board", "Set up, check and read the board that measures the cords"),
    },
    "Calibrate": {
        "calibrate": ("calibrate.calibrate", "Measure the response of a cord on specimens"),
        "recalibrate": ("train.recalibrate", "Adapt a model to changed resistances at rest"),
    },
    "Record and train": {
        "capture": (
            "capture.capture",
            "Print tags, calibrate cameras, record sessions",
        ),
        "twin": ("train.twin", "Simulate recordings of a built device"),
        "dataset": ("train.dataset", "Export the data of sessions for other programs"),
        "train": ("train.train", "Train a model that converts resistances to marker positions"),
        "evaluate": ("train.evaluate", "Evaluate models on data they were not trained on"),
    },
    "Run": {
        "run": ("run.run", "Run a device live"),
        "reproduce": ("design.reproduce", "Repeat the experiments of the paper"),
    },
    "Help": {
        "list": ("help.list:list_rows", "Show the materials, cords and printers to choose from"),
        "doctor": ("help.doctor", "Check dependencies and show how to install missing ones"),
        "cache": ("help.cache", "Clear cached meshes, solved poses and compiled code"),
        "licences": ("help.licences", "List the licenses of the installed libraries"),
        "completion": ("help.completion", "Print the script that completes commands in a shell"),
    },
}
