"""How Sphinx builds the guide: `make guide` writes it to build/guide, to be opened from there."""

import re
import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]

project = "defsense-fab"
author = "the defsense-fab authors"
extensions = ["myst_parser"]
source_suffix = {".md": "markdown"}
myst_heading_anchors = 3
nitpicky = True
html_theme = "furo"  # no fonts or scripts from elsewhere: the site works from a file, offline
html_title = "defsense-fab"
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False
html_show_search_summary = False  # would be fetched, which browsers refuse for files

_MENTION = re.compile(r"`docs/([a-z0-9-]+)\.md`")


def _links(_app, _docname, source):
    """Pages name each other as files of the repository; here these names become links."""
    source[0] = _MENTION.sub(r"[](/\1.md)", source[0])


def setup(app):
    """Sphinx calls this."""
    from device_reference import DeviceKeys

    app.connect("source-read", _links)
    app.add_directive("device-keys", DeviceKeys)
    return {"parallel_read_safe": True}
