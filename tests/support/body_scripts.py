"""A body script that imports only the CAD kernel, which takes a third of the time of build123d."""

HEAD = """\
from types import SimpleNamespace
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox
from OCP.gp import gp_Pnt
def box(length, width, height):
    corner = gp_Pnt(0, -width / 2, -height / 2)
    return SimpleNamespace(wrapped=BRepPrimAPI_MakeBox(corner, length, width, height).Solid())
"""
#: The body of `fixtures/devices/bar`.
BAR_SCRIPT = HEAD + (
    "def body(length=150.0, width=30.0, height=30.0): return box(length, width, height)\n"
)


def write_bar(folder):
    """Write the script of the bar into a folder."""
    (folder / "bar.py").write_text(BAR_SCRIPT, encoding="utf-8")
