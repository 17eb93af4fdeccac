"""The reference of the Python interface: every public name of `defsense_fab`, from its docstring.

`make guide` puts it where a page says ```{python-names}```.
"""

from __future__ import annotations

import inspect
import sys

from sphinx.util.docutils import SphinxDirective

import defsense_fab

#: In the order of the work; modules that are not named here come after these.
_ORDER = ("device", "bodies", "regions", "poses", "simulation", "layout", "prediction", "parts",
          "recordings", "model", "surface", "live", "live_frame", "picture", "errors")  # fmt: skip


def public_names():
    """Names of the interface by the modules that define them, in the order of the work."""
    found = {}
    for name in dir(defsense_fab):
        if not name.startswith("_"):
            module = getattr(getattr(defsense_fab, name), "__module__", None) or ""
            if module.startswith("defsense_fab."):
                found.setdefault(module, []).append(name)

    def place(module):
        last = module.rpartition(".")[2]
        return _ORDER.index(last) if last in _ORDER else len(_ORDER), last

    return {module: found[module] for module in sorted(found, key=place)}


def _title(module):
    return module.rpartition(".")[2].replace("_", " ").capitalize()


def markdown():
    """A section a module, with its names as autodoc shows them."""
    parts = []
    for module, names in public_names().items():
        about = inspect.getdoc(sys.modules[module]).splitlines()[0]
        parts.append(f"## {_title(module)}\n\n{about}\n\n```{{eval-rst}}")
        for name in names:
            kind = "class" if inspect.isclass(getattr(defsense_fab, name)) else "function"
            parts.append(f".. auto{kind}:: defsense_fab.{name}")
            parts += ["   :members:", ""] if kind == "class" else [""]
        parts.append("```\n")
    return "\n".join(parts)


class PythonNames(SphinxDirective):
    """The reference, in place of the directive."""

    def run(self):
        """Sphinx calls this."""
        for module in public_names():
            self.env.note_dependency(sys.modules[module].__file__)
        return self.parse_text_to_nodes(markdown(), allow_section_headings=True)
