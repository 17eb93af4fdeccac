"""The question whether a script may run, with its text before one's eyes."""

from __future__ import annotations

import html
import unicodedata
from collections.abc import Callable
from typing import Any

from ...geometry.bodies.script_source import ScriptText

_MOST = 100_000  # characters that are shown
_STYLE = (
    "max-height: 45vh; overflow: auto; white-space: pre-wrap; overflow-wrap: anywhere;"
    " font-size: 0.8em; line-height: 1.35; border: 1px solid #8888; padding: 0.6em; margin: 0.4em 0"
)


class ScriptQuestion:
    """A window over the page of all browsers, one at a time."""

    def __init__(self, server: Any) -> None:
        self._server, self._window = server, None

    @property
    def open(self) -> bool:
        """Whether it waits for an answer."""
        return self._window is not None

    def ask(
        self, script: ScriptText, agreed: Callable[[], None], refused: Callable[[], None]
    ) -> None:
        """Show the script; one of the two is called by the person's click."""
        self.close()
        gui = self._server.gui
        window: Any = gui.add_modal("May this script run?")
        self._window = window

        def button(label: str, color: str, then: Callable[[], None]) -> None:
            def clicked(_: Any) -> None:
                if self._window is window:  # two browsers may click at once
                    self.close()
                    then()

            gui.add_button(label, color=color).on_click(clicked)

        with window:
            gui.add_html(question(script))
            button("Run it: I know where it comes from", "orange", agreed)
            button("Do not run it", "gray", refused)

    def close(self) -> None:
        """Take the window away."""
        if self._window is not None:
            window, self._window = self._window, None
            window.close()


def question(script: ScriptText) -> str:
    """HTML: what is asked, and all that would run."""
    parts = [
        f"<p>The body is made by the script <b>{_seen(str(script.path))}</b>. It is a program: it"
        " may do on this machine what you may, such as reading and deleting your files. Run it only"
        " if you wrote it, trust who did, or see below that it only draws a body. You are asked"
        " again when it changes.</p>"
    ]
    for name, content in script.files:
        if len(script.files) > 1:
            parts.append(f"<b>{_seen(name)}</b>")
        parts.append(f'<pre style="{_STYLE}">{_text(name, content)}</pre>')
    return "".join(parts)


def _text(name: str, content: bytes) -> str:
    if not name.endswith(".py"):
        return f"({len(content):,} bytes of machine code, which cannot be shown)"
    text = content.decode("utf-8", errors="replace")
    left = len(text) - _MOST
    more = f"\n... and {left:,} characters more: look at the file in an editor" if left > 0 else ""
    return _seen(text[:_MOST]) + more


def _seen(text: str) -> str:
    """As HTML; characters that change how others are read are shown as what they are."""
    return "".join(
        f"<mark>\\u{ord(c):04x}</mark>"
        if unicodedata.category(c) in ("Cf", "Cc", "Co", "Cs") and c not in "\n\t\r"
        else html.escape(c)
        for c in text
    )
