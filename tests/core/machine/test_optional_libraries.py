"""Test the error for each optional library that is missing."""

from __future__ import annotations

import ast
import shlex
import sys
import tomllib

import pytest

from defsense_fab.core.errors import CaptureError, DefsenseError
from defsense_fab.core.machine import optional_libraries
from defsense_fab.core.machine.optional_libraries import CORE, missing, optional, pip_install
from tests.support.errors import raises
from tests.support.places import ROOT

PACKAGE = ROOT / "defsense_fab"
#: Modules of distributions with other names.
_MODULES = {"python-rtmidi": "rtmidi", "usd-core": "pxr"}
#: Imports that are guarded elsewhere, and where.
_GUARDED_ELSEWHERE = {
    "runtime/recording/usd_animation.py": "require_usd is called before",
    "runtime/outputs/lsl_output.py": "live_file guards the import of this module",
    "runtime/outputs/midi_ports.py": "describes itself which of two packages has it",
    "workflow/build/cluster.py": "called once `connect` has imported it",
}


def _extras():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    groups = project["project"]["optional-dependencies"]
    requirements = [t for name, ts in groups.items() if name not in ("dev", "all") for t in ts]
    names = {t.partition(">")[0].partition("[")[0].strip() for t in requirements}
    return {_MODULES.get(n, n) for n in names - {"defsense-fab"}} | {"evdev"}


def _imports(tree, guarded=False):
    """Yield top-level names of modules, and whether they are in `with optional(...)`."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.Import):
            yield from ((a.name.partition(".")[0], guarded) for a in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module.partition(".")[0], guarded
        within = isinstance(node, ast.With) and any(
            getattr(getattr(i.context_expr, "func", None), "id", "") == "optional"
            for i in node.items
        )
        yield from _imports(node, guarded or within)


def test_every_import_of_an_extra_is_guarded():
    extras, unguarded = _extras(), set()
    guarded = set()
    for path in PACKAGE.rglob("*.py"):
        for name, within in _imports(ast.parse(path.read_text(encoding="utf-8"))):
            if name in extras:
                place = path.relative_to(PACKAGE).as_posix()
                (guarded if within else unguarded).add(place)
    assert unguarded == set(_GUARDED_ELSEWHERE)
    assert len(guarded) >= 7


def _c3d(path):
    from defsense_fab.capture.files.c3d import _library

    _library(path / "a.c3d")


def _parquet(path):
    from defsense_fab.capture.files.formats import _libraries

    _libraries(path / "a.parquet")


def _dataset(path):
    from defsense_fab.training.recordings.dataset_parquet import parquet_library

    parquet_library(path / "a.parquet")


def _xdf(path):
    from defsense_fab.training.recordings.xdf_streams import read_streams

    read_streams(path / "a.xdf")


def _usd(path):
    from defsense_fab.runtime.recording.usd_animation import require_usd

    require_usd(path / "a.usdz")


def _cluster(path):
    from defsense_fab.workflow.build.cluster import connect

    with connect("tcp://127.0.0.1:1"):
        pass


@pytest.mark.parametrize(
    ("library", "extra", "use"),
    [
        ("ezc3d", "exchange", _c3d),
        ("pyarrow", "exchange", _parquet),
        ("pyarrow", "exchange", _dataset),
        ("pyxdf", "exchange", _xdf),
        ("pxr", "animation", _usd),
        ("distributed", "cluster", _cluster),
    ],
)
def test_missing_library_is_one_line(library, extra, use, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, library, None)
    monkeypatch.delitem(sys.modules, f"{library}.parquet", raising=False)
    requirement = f"defsense-fab[{extra}]"
    with raises(DefsenseError, "library-missing", requirement=requirement) as caught:
        use(tmp_path)
    assert pip_install(requirement) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_library_that_cannot_be_loaded_is_not_called_missing():
    with (
        raises(CaptureError, "library-broken", package="rtmidi") as caught,
        optional(CaptureError, "midi", "live", "rtmidi"),
    ):
        raise ImportError("libasound.so.2:\n no such file", name="rtmidi")
    assert "libasound.so.2: no such file" in str(caught.value)


def test_command_is_quoted_for_the_shell(monkeypatch):
    monkeypatch.setattr(optional_libraries.sys, "executable", "/home/a b/python")
    words = shlex.split(pip_install("numpy>=2", "evdev"))
    assert words == ["/home/a b/python", "-m", "pip", "install", "numpy>=2", "evdev"]
    error = ModuleNotFoundError(name="foo.bar")
    assert pip_install("foo") in missing("a", error)
    assert pip_install("defsense-fab") in missing("a", error, CORE)
