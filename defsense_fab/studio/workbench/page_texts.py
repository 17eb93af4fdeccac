"""Texts on the page: a status with its code, tables and lists in markdown."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from typing import Any

from ...core.errors import DefsenseError

_ALIGNMENTS = {"l": "---", "r": "---:"}


class StatusText:
    """A text on the page that states what a part of the studio does.

    Attributes:
        text: The text in markdown.
        code: Identifier of the status, such as "busy", or the code of the error.
        error: The error that is shown, or None.
    """

    def __init__(self, text: str = "", code: str = "") -> None:
        self.text, self.code = text, code
        self.error: Exception | None = None
        self._handle: Any = None

    def add_panel(self, gui: Any) -> None:
        """Add the text to the open folder of the panel."""
        self._handle = gui.add_markdown(self.text)

    def show(self, text: str, code: str = "", error: Exception | None = None) -> None:
        """Show a text in markdown.

        Args:
            text: The text; empty for none.
            code: Stable identifier of the status, such as "no-cord-chosen".
            error: The error that the text is about, if any.
        """
        self.text, self.code, self.error = text, code, error
        if self._handle is not None:
            self._handle.content = text

    def show_problem(self, text: str, code: str) -> None:
        """Show in bold what the user has to do first."""
        self.show(f"**{text}**", code)

    def show_error(self, error: Exception, task: str = "") -> None:
        """Show an error; the studio continues.

        Args:
            error: The error.
            task: Subject of the sentence about a fault of the program, such as "The recording".
        """
        text, code = str(error), "task-failed"
        if isinstance(error, DefsenseError):
            code = error.code
        elif task:
            text = f"{task} failed ({type(error).__name__}: {error})."
        self.show(f"**{text}**", code, error)


def markdown_table(
    header: Sequence[str], rows: Iterable[Sequence[str]], alignment: str = "lr"
) -> str:
    """Return a table in markdown.

    Args:
        header: Titles of the columns.
        rows: Cells of each row in markdown; see `escape_cell`.
        alignment: "l" or "r" for each column; the last one holds for all further columns.
    """
    aligned = alignment.ljust(len(header), alignment[-1])[: len(header)]
    lines = [header, [_ALIGNMENTS[letter] for letter in aligned], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def escape_cell(text: str) -> str:
    """Return a text that neither ends its cell of a markdown table nor is read as HTML."""
    return html.escape(text, quote=False).replace("|", "\\|")


def bullet_list(lines: Iterable[str]) -> str:
    """Return lines as a list in markdown; empty for none."""
    return "\n".join(f"- {line}" for line in lines)
