"""Test that cached machine code is that of the current sources."""

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import defsense_fab
from defsense_fab.core.machine.compiled import source_files

PACKAGE = Path(defsense_fab.__file__).parent
USERS = [
    p
    for p in PACKAGE.rglob("*.py")
    if re.search(r"^@compiled\(", p.read_text(encoding="utf-8"), re.M)
]

CALLER = """
from defsense_fab.core.machine.compiled import compiled
from .callee import (
    add,
)

@compiled()
def twice(x):
    return 2 * add(x)
"""
CALLEE = """
from defsense_fab.core.machine.compiled import compiled
from . import constants
from .constants import STEP as step

@compiled()
def add(x):
    return x + step
"""
ASK = "from defsense_fab.core.machine.compiled import is_compiled; import kernels.caller as c; "
SHOW = "from kernels.caller import twice; print(twice(1), sum(twice.stats.cache_hits.values()))"


@pytest.fixture
def kernels(tmp_path):
    folder = tmp_path / "kernels"
    folder.mkdir()
    for name, text in (("caller", CALLER), ("callee", CALLEE), ("constants", "STEP = 10\n")):
        (folder / f"{name}.py").write_text(text)
    (folder / "__init__.py").write_text("")
    return folder


def run(folder):
    """Return the value, and whether its machine code was cached."""
    paths = f"import sys; sys.path[:0] = [{str(folder.parent)!r}, {str(PACKAGE.parent)!r}]; "
    done = subprocess.run(
        [sys.executable, "-B", "-c", paths + SHOW], capture_output=True, text=True, check=True
    )
    value, hits = done.stdout.split()
    return int(value), int(hits) > 0


@pytest.mark.slow
def test_edit_in_another_file_has_an_effect(kernels):
    assert run(kernels) == (22, False)
    assert run(kernels) == (22, True)
    (kernels / "callee.py").write_text(CALLEE.replace("x + step", "x - step"))
    assert run(kernels) == (-18, False)
    (kernels / "constants.py").write_text("STEP = 100\n")
    assert run(kernels) == (-198, False)
    assert run(kernels) == (-198, True)
    # Folders of earlier states are removed.
    cached = sorted(p.name.split("-")[0] for p in (kernels / "__pycache__").glob("*-*"))
    assert cached == ["callee", "caller"]


@pytest.mark.slow
def test_is_compiled_is_known_before_the_first_call(kernels):
    def run_code(then):
        code = f"import sys; sys.path[:0] = [{str(kernels.parent)!r}, {str(PACKAGE.parent)!r}]; "
        done = subprocess.run(
            [sys.executable, "-B", "-c", code + ASK + then], capture_output=True, text=True,
            check=True,
        )  # fmt: skip
        return done.stdout.split()

    assert run_code("print(is_compiled(c)); c.twice(1); print(is_compiled(c))") == ["False", "True"]
    assert run_code("print(is_compiled(c))") == ["True"]
    (kernels / "constants.py").write_text("STEP = 100\n")
    assert run_code("print(is_compiled(c))") == ["False"]


@pytest.mark.parametrize("path", USERS, ids=lambda p: p.stem)
def test_key_covers_all_modules_in_use(path):
    """Every object of the package in a module with compiled functions comes from its sources."""
    name = "defsense_fab." + ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
    module = importlib.import_module(name)
    modules = {getattr(x, "__module__", None) or "" for x in vars(module).values()} - {name}
    used = {n for n in modules if n.startswith("defsense_fab.")}
    files = {Path(sys.modules[n].__file__) for n in used}
    assert files
    assert files <= source_files(path)


def test_numba_is_used_only_by_compiled():
    assert len(USERS) > 10
    for path in PACKAGE.rglob("*.py"):
        if path != PACKAGE / "core" / "machine" / "compiled.py":
            assert not re.search(
                r"\bn?jit\(|\bvectorize\(|\bimport numba\b", path.read_text(encoding="utf-8")
            )
