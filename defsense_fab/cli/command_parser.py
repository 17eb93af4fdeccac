"""The parser of all commands: its help ends with examples, one a line."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any


class CommandParser(argparse.ArgumentParser):
    """An ArgumentParser with `examples`: whole command lines, which its help does not wrap, so that
    each can be copied. The parsers that are added to it are of this class too."""

    def __init__(self, *words: Any, examples: Sequence[str] = (), **options: Any) -> None:
        super().__init__(*words, **options)
        self.examples = tuple(examples)

    def format_help(self) -> str:
        """The help as argparse has it, and the examples below."""
        if not self.examples:
            return super().format_help()
        title = "example" if len(self.examples) == 1 else "examples"
        lines = "".join(f"  {line}\n" for line in self.examples)
        return f"{super().format_help()}\n{title}:\n{lines}"
