"""How Sphinx builds the guide: `make guide` writes it to build/guide, to be opened from there."""

import re
import sys
from pathlib import Path

from sphinx.util.inspect import TypeAliasForwardRef

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]

project = "defsense-fab"
author = "the defsense-fab authors"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
napoleon_use_ivar = True
napoleon_use_rtype = False
source_suffix = {".md": "markdown"}
myst_heading_anchors = 3
nitpicky = True
nitpick_ignore_regex = [("py:.*", ".*")]  # types of other libraries have no page here
default_role = "code"  # docstrings mark names by single backticks
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_type_aliases = {
    name: name for name in ("ArrayLike", "Float", "Bool", "Int", "Progress", "Shape")
}
TypeAliasForwardRef.__repr__ = lambda alias: alias.name  # Sphinx 9 shows it in `Float | None`
add_module_names = False
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 80
toc_object_entries_show_parents = "hide"
html_theme = "furo"  # no fonts or scripts from elsewhere: the site works from a file, offline
html_title = "defsense-fab"
html_static_path = ["html_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False
html_show_search_summary = False  # would be fetched, which browsers refuse for files

_MENTION = re.compile(r"`docs/([a-z0-9/-]+)\.md`")


def _links(_app, _docname, source):
    """Pages name each other as files of the repository; here these names become links."""
    source[0] = _MENTION.sub(r"[](/\1.md)", source[0])


def _plain_defaults(_app, _what, _name, _object, _options, signature, returns):
    """Replace the default of a dataclass's field, which Sphinx cannot parse."""
    return signature and re.sub(r"<factory>|<object object at [^>]*>", "...", signature), returns


def setup(app):
    """Sphinx calls this."""
    from command_reference import Commands
    from file_reference import FileKeys, Glues, MaterialsOfProcesses, write_schemas
    from python_reference import PythonNames

    app.connect("source-read", _links)
    app.connect("autodoc-process-signature", _plain_defaults)
    app.connect("build-finished", write_schemas)
    app.add_directive("commands", Commands)
    app.add_directive("file-keys", FileKeys)
    app.add_directive("glues", Glues)
    app.add_directive("materials-of-processes", MaterialsOfProcesses)
    app.add_directive("python-names", PythonNames)
    return {"parallel_read_safe": True}
