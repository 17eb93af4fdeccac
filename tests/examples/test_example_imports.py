"""Examples and notebooks use the public interface: of the package they import nothing else."""

import ast
import json

import pytest

from tests.support.places import ROOT

PACKAGE = "defsense_fab"
EXAMPLES = ROOT / "examples"
FILES = sorted(
    path.relative_to(EXAMPLES).as_posix()
    for suffix in ("py", "ipynb")
    for path in EXAMPLES.rglob(f"*.{suffix}")
)


def read_code(name):
    """Return the Python code of a file or of the cells of a notebook."""
    text = (EXAMPLES / name).read_text(encoding="utf-8")
    if not name.endswith(".ipynb"):
        return text
    cells = [c for c in json.loads(text)["cells"] if c["cell_type"] == "code"]
    return "\n".join("".join(cell["source"]) for cell in cells)


def internal_imports(code):
    """Return the modules of the package that code imports, without the package itself."""
    modules = []
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            modules += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            modules.append(node.module or "")
    return [m for m in modules if m.startswith(f"{PACKAGE}.")]


@pytest.mark.parametrize("name", FILES)
def test_example_imports_the_public_interface_only(name):
    assert internal_imports(read_code(name)) == []


def test_internal_imports_are_found():
    code = "from defsense_fab.core import mesh\ndef f():\n    import defsense_fab.store"
    assert internal_imports(code) == ["defsense_fab.core", "defsense_fab.store"]


@pytest.mark.parametrize("name", [n for n in FILES if n.endswith(".py")])
def test_names_of_the_interface_exist(name):
    import defsense_fab as df

    names = {
        node.attr
        for node in ast.walk(ast.parse(read_code(name)))
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "df"
    }
    assert names <= set(dir(df))
