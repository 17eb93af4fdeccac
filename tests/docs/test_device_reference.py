"""Every key that the code reads from a device's file is explained, and commands are told apart."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
CORE = ROOT / "defsense_fab/core"
_READS = {"string", "number", "size", "boolean", "vector", "array", "strings", "raw", "table",
          "tables", "_count"}  # fmt: skip


def keys_read(path):
    """The keys that a module reads by methods of `Table`, and by loops over names of keys."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", None))
            if name in _READS:
                for a in node.args[:2]:
                    if isinstance(a, ast.Constant) and isinstance(a.value, str):
                        yield a.value
                        break
        elif isinstance(node, ast.For) and getattr(node.target, "id", "") == "key":
            yield from (
                e.value for e in getattr(node.iter, "elts", ()) if isinstance(e, ast.Constant)
            )


def test_every_key_of_a_device_file_is_on_its_page():
    page = (ROOT / "docs/device.md").read_text(encoding="utf-8")
    explained = set(re.findall(r"[a-z][a-z_0-9]*", " ".join(re.findall(r"`([^`]*)`", page))))
    read = {
        k
        for f in ("device_file", "pose_file", "material_table")
        for k in keys_read(CORE / f"{f}.py")
    }
    assert len(read) > 60
    assert read - explained == set()
