"""Text of others in a table of markdown."""

from __future__ import annotations

import html


def table_cell(text: str) -> str:
    """A name or message as it is to be read: it neither ends its cell nor is taken for HTML."""
    return html.escape(text, quote=False).replace("|", "\\|")
