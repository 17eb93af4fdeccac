"""The parser of all commands: its help ends with examples, one a line."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any


class CommandParser(argparse.ArgumentParser):
    """An ArgumentParser with `examples`: whole command lines, which its help does not wrap, so that
    each can be copied; and with `tasks`, under which its commands stand in the help. The parsers
    that are added to it are of this class too."""

    def __init__(
        self,
        *words: Any,
        examples: Sequence[str] = (),
        tasks: Mapping[str, Sequence[str]] | None = None,
        **options: Any,
    ) -> None:
        super().__init__(*words, **options)
        self.examples = tuple(examples)
        self.tasks = tasks or {}

    def format_help(self) -> str:
        """The help as argparse has it, its commands by task, and the examples below."""
        text = self._help_by_task() if self.tasks else super().format_help()
        if not self.examples:
            return text
        title = "example" if len(self.examples) == 1 else "examples"
        lines = "".join(f"  {line}\n" for line in self.examples)
        return f"{text}\n{title}:\n{lines}"

    def _help_by_task(self) -> str:
        """As ArgumentParser.format_help, with a section a task for the commands."""
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
