"""The reference of the Python interface: every public name of `defsense_fab`, from its docstring.

`make guide` puts it where a page says ```{python-names}```.
"""

from __future__ import annotations

import inspect
import sys

from sphinx.util.docutils import SphinxDirective

import defsense_fab

#: In the order of the work; modules that are not named here come after these.
_ORDER = ("device", "regions", "poses", "simulation", "layout", "prediction", "parts",
          "recordings", "dataset", "model", "surface", "live", "live_frame", "mesh", "picture",
          "errors")  # fmt: skip


def public_names():
    """Names of the interface with the modules that define them, in sections by the modules' own
    names, in the order of the work."""
    found = {}
    for name in dir(defsense_fab):
        if not name.startswith("_"):
            module = getattr(getattr(defsense_fab, name), "__module__", None) or ""
            if module.startswith("defsense_fab."):
                found.setdefault(module.rpartition(".")[2], []).append((name, module))

    def place(section):
        return _ORDER.index(section) if section in _ORDER else len(_ORDER), section

    return {section: found[section] for section in sorted(found, key=place)}


def markdown():
    """A section after the other, with its names as autodoc shows them."""
    parts = []
    for section, names in public_names().items():
        title = section.replace("_", " ").capitalize()
        own = min(module for _, module in names)  # that of api, where it is of several
        about = inspect.getdoc(sys.modules[own]).splitlines()[0]
        parts.append(f"## {title}\n\n{about}\n\n```{{eval-rst}}")
        for name, _ in names:
            kind = "class" if inspect.isclass(getattr(defsense_fab, name)) else "function"
            parts.append(f".. auto{kind}:: defsense_fab.{name}")
            parts += ["   :members:", ""] if kind == "class" else [""]
        parts.append("```\n")
    return "\n".join(parts)


class PythonNames(SphinxDirective):
    """The reference, in place of the directive."""

    has_content = True  # shown where the Markdown is read without the site

    def run(self):
        """Sphinx calls this."""
        modules = {module for names in public_names().values() for _, module in names}
        for module in modules:
            self.env.note_dependency(sys.modules[module].__file__)
        return self.parse_text_to_nodes(markdown(), allow_section_headings=True)
