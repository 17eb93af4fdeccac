"""Body scripts as text: their parameters, and the files that run with them."""

from __future__ import annotations

import pytest

from defsense_fab.core.errors import BodyError
from defsense_fab.workflow.starts.body_scripts import read_parameters, read_script
from tests.support.errors import raises

SCRIPT = """
from typing import Annotated, Literal
import typing
open("ran", "w")
raise SystemExit("never run")

def body(
    length: Annotated[float, (10, 300)],
    width=30.0,
    count=4,
    wall: "typing.Annotated[int, (1, 9), 'layers']" = 2,
    hollow=False,
    shape: Literal["round", "square"] = "round",
    end: Annotated[str, ("flat", "domed")] = "flat",
    title="x",
    points=((0, 0), (1, 1)),
    lean: Annotated[float, "deg"] = -5.0,
    *,
    free,
):
    return None
"""


@pytest.fixture
def script(tmp_path):
    path = tmp_path / "shape.py"
    path.write_text(SCRIPT)
    return path


def test_parameters_are_read_without_running_the_script(script, tmp_path):
    source = {p.name: p for p in read_parameters(script, {"free": 7, "length": 40})}
    kinds = {name: p.kind for name, p in source.items()}
    assert kinds == {
        "length": "number", "width": "number", "count": "whole", "wall": "whole",
        "hollow": "switch", "shape": "choice", "end": "choice", "title": "text", "points": "other",
        "lean": "number", "free": "number",
    }  # fmt: skip
    assert not (tmp_path / "ran").exists()
    assert source["length"].bounds(40) == (10, 300)
    assert source["length"].bounds(500) == (10, 500)  # what the device says can be shown
    assert source["width"].bounds(30) == pytest.approx((6, 90))
    assert source["count"].bounds(4) == (0, 12)
    assert source["lean"].bounds(-5) == pytest.approx((-15, -1))
    assert source["free"].bounds(7) == pytest.approx((1.4, 21))
    assert source["end"].choices == ("flat", "domed")
    assert [source[n].unit for n in ("length", "count", "wall", "lean")] == [
        "mm",
        "",
        "layers",
        "deg",
    ]


@pytest.mark.parametrize(
    ("text", "codes"),
    [
        ("def body(:\n", ["script-syntax"]),
        ("def other(): pass\n", ["no-body-function"]),
        ("x = 1\0", ["file-unreadable", "script-syntax"]),
    ],
)
def test_unreadable_scripts_are_refused_with_their_line(tmp_path, text, codes):
    path = tmp_path / "shape.py"
    path.write_text(text)
    with pytest.raises(BodyError) as caught:
        read_parameters(path, {})
    assert caught.value.code in codes
    if codes == ["script-syntax"]:
        assert caught.value.data["line"] == 1


def test_files_that_may_run_with_a_script_belong_to_it(tmp_path):
    path = tmp_path / "shape.py"
    path.write_text("import parts.lid\nfrom sub import tool\nimport numpy\n")
    for name, text in {
        "parts/__init__.py": "", "parts/lid.py": "from . import rim\n", "parts/rim.py": "x = 1\n",
        "sub/tool.py": "", "sub/unused.py": "", "json.py": "", "note.txt": "", "build/x.py": "",
    }.items():  # fmt: skip
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    source = read_script(path)
    names = [name for name, _ in source.files]
    # json.py is imported by libraries, before their own.
    assert names == [
        "shape.py", "json.py", "parts/__init__.py", "parts/lid.py", "parts/rim.py", "sub/tool.py",
    ]  # fmt: skip
    for name in names:
        before = read_script(path).digest
        (tmp_path / name).write_text((tmp_path / name).read_text("utf-8") + "# changed\n")
        assert read_script(path).digest != before
    before = read_script(path).digest
    (tmp_path / "note.txt").write_text("other")
    (tmp_path / "build/x.py").write_text("other")
    assert read_script(path).digest == before
    (tmp_path / "math2.so").write_bytes(b"\x7fELF")
    assert read_script(path).digest != before


def test_missing_script_is_reported(tmp_path):
    with raises(BodyError, "file-unreadable"):
        read_script(tmp_path / "none.py")
