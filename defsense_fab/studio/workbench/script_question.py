"""The question whether a body's script may run, with the script's text."""

from __future__ import annotations

import html
import unicodedata
from collections.abc import Callable
from typing import Any

from ...workflow.starts.body_scripts import ScriptText

RUN_LABEL, REFUSE_LABEL = "Run it: I know where it comes from", "Do not run it"
_MAX_SHOWN_CHARACTERS = 100_000
_STYLE = (
    "max-height: 45vh; overflow: auto; white-space: pre-wrap; overflow-wrap: anywhere;"
    " font-size: 0.8em; line-height: 1.35; border: 1px solid #8888; padding: 0.6em; margin: 0.4em 0"
)


class ScriptQuestion:
    """A dialog over the page in all browsers, one at a time.

    Args:
        server: The viser server.
    """

    def __init__(self, server: Any) -> None:
        self._server, self._window = server, None
        self._answers: dict[str, Callable[[], None]] = {}

    @property
    def is_open(self) -> bool:
        """Whether the dialog waits for an answer."""
        return self._window is not None

    def ask(
        self, script: ScriptText, on_agree: Callable[[], None], on_refuse: Callable[[], None]
    ) -> None:
        """Show the script; the user's click calls one of the two functions."""
        self.close()
        gui = self._server.gui
        window: Any = gui.add_modal("May this script run?")
        self._window = window

        def add_button(label: str, color: str, action: Callable[[], None]) -> None:
            def answer() -> None:
                if self._window is window:  # two browsers may click at once
                    self.close()
                    action()

            self._answers[label] = answer
            gui.add_button(label, color=color).on_click(lambda _: answer())

        with window:
            gui.add_html(script_html(script))
            add_button(RUN_LABEL, "orange", on_agree)
            add_button(REFUSE_LABEL, "gray", on_refuse)

    def answer(self, *, run: bool) -> None:
        """Answer the open question, as a click does."""
        self._answers[RUN_LABEL if run else REFUSE_LABEL]()

    def close(self) -> None:
        """Close the dialog."""
        if self._window is not None:
            window, self._window = self._window, None
            window.close()


def script_html(script: ScriptText) -> str:
    """Return the question, and all code that would run, as HTML."""
    parts = [
        f"<p>The body is made by the script <b>{_escape(str(script.path))}</b>. The script is a"
        " program: it can do on this computer what you can, such as read and delete your files."
        " Run it only if you wrote it, trust its author, or see below that it only draws a body."
        " The studio asks again when the script changes.</p>"
    ]
    for name, content in script.files:
        if len(script.files) > 1:
            parts.append(f"<b>{_escape(name)}</b>")
        parts.append(f'<pre style="{_STYLE}">{_file_html(name, content)}</pre>')
    return "".join(parts)


def _file_html(name: str, content: bytes) -> str:
    if not name.endswith(".py"):
        return f"({len(content):,} bytes of machine code, which cannot be shown)"
    text = content.decode("utf-8", errors="replace")
    hidden = len(text) - _MAX_SHOWN_CHARACTERS
    note = f"\n... {hidden:,} more characters. Open the file in an editor" if hidden > 0 else ""
    return _escape(text[:_MAX_SHOWN_CHARACTERS]) + note


def _escape(text: str) -> str:
    """Escape HTML, and show characters that change how others are displayed by their code."""
    return "".join(
        f"<mark>\\u{ord(c):04x}</mark>"
        if unicodedata.category(c) in ("Cf", "Cc", "Co", "Cs") and c not in "\n\t\r"
        else html.escape(c)
        for c in text
    )
