"""Markdown of viser's pages without HTML.

Viser renders HTML in markdown as it is, scripts included, and reads the files that images name. But
names of devices and messages of errors come from folders of others: a device that is called
`<script>` must not run.
"""

from __future__ import annotations

import re
from pathlib import Path

_JOIN = "\u2060"  # is not seen, and parts what would be a tag or an image
_BEGINS = re.compile(r"<(?=[A-Za-z/!?])|!(?=\[)")


def plain_markdown(markdown: str, image_root: Path | None = None) -> str:  # noqa: ARG001 - viser's
    """The text with tags and images to be read, not followed."""
    return _BEGINS.sub(lambda found: found[0] + _JOIN, markdown)
