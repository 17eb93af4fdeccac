"""Argument parser whose help lists commands by task and ends with examples."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any


class CommandParser(argparse.ArgumentParser):
    """Argument parser with examples and with commands grouped by task.

    Parsers of subcommands that are added to it are of this class too.

    Args:
        *args: As for `argparse.ArgumentParser`.
        examples: Complete command lines. The help prints each on one line of its own, so that it
            can be copied.
        tasks: Names of subcommands by the title of their section in the help.
        **kwargs: As for `argparse.ArgumentParser`.
    """

    def __init__(
        self,
        *args: Any,
        examples: Sequence[str] = (),
        tasks: Mapping[str, Sequence[str]] | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(*args, **kwargs)
        self.examples = tuple(examples)
        self.tasks = tasks or {}
        for action in self._actions:
            if action.dest == "help":
                action.help = "Show this help and exit"

    def format_help(self) -> str:
        """Return the help text: usage, description, commands by task, options, examples."""
        text = self._format_help_by_task() if self.tasks else super().format_help()
        if not self.examples:
            return text
        title = "example" if len(self.examples) == 1 else "examples"
        lines = "".join(f"  {line}\n" for line in self.examples)
        return f"{text}\n{title}:\n{lines}"

    def _format_help_by_task(self) -> str:
        """Return the help as `ArgumentParser.format_help` does, with one section per task."""
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        commands = {
            command.dest: command
            for action in self._actions
            if isinstance(action, argparse._SubParsersAction)
            for command in action._choices_actions
        }
        for task, names in self.tasks.items():
            formatter.start_section(task)
            formatter.add_arguments([commands[name] for name in names if name in commands])
            formatter.end_section()
        formatter.start_section("options")
        formatter.add_arguments([a for a in self._actions if a.option_strings])
        formatter.end_section()
        formatter.add_text(self.epilog)
        return formatter.format_help()
