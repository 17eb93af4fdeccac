"""The reference of `device.toml` says of each key what its reader does."""

import ast
import importlib.util
import sys
import tomllib
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from defsense_fab.core.device.device_file import read_device
from defsense_fab.core.device.device_keys import KEYS
from defsense_fab.core.errors import DeviceError
from defsense_fab.core.storage.toml_table import Table

ROOT = Path(__file__).parents[2]
DEVICE_ROOM = ROOT / "defsense_fab/core/device"
_READS = {"string", "number", "size", "count", "boolean", "vector", "array", "strings", "raw",
          "table", "tables"}  # fmt: skip


@pytest.fixture(scope="module")
def reference():
    spec = importlib.util.spec_from_file_location(
        "device_reference", ROOT / "docs/device_reference.py"
    )
    module = sys.modules["device_reference"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def read(reference, tmp_path_factory):
    folder = tmp_path_factory.mktemp("device")
    reference.write_files(folder)
    return lambda data: read_device(Table(data, folder / "device.toml", ""), folder, {})


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


def test_every_key_in_the_readers_code_is_explained():
    told = {key.rpartition(".")[2] for keys in KEYS.values() for key in keys}
    read = {
        k
        for f in ("device_file", "pose_file", "material_table")
        for k in keys_read(DEVICE_ROOM / f"{f}.py")
    }
    assert len(read) > 60
    assert read - told == set()


def holder(data, one):
    """The innermost table of this device that holds a key, and the key's last name; None where the
    device has no such table."""
    names = one.table.strip("[]").split(".") if one.table else []
    *way, last = one.key.split(".")
    for name in (*names, *way):
        data = data.get(name) if isinstance(data, dict) else None
        data = data[0] if isinstance(data, list) and data else data
    return (data, last) if isinstance(data, dict) else None


def same(a, b):
    return all(
        np.array_equal(x, y, equal_nan=True) if isinstance(x, np.ndarray) else repr(x) == repr(y)
        for x, y in ((getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    )


def test_defaults_are_what_a_device_without_the_key_has(reference, read):
    checked = set()
    for one in reference.explained():
        if len(one.defaults) != 1 or one.key == "name":
            continue
        for text in reference.variants():
            with_it, without = tomllib.loads(text), tomllib.loads(text)
            if not (place := holder(with_it, one)):
                continue
            table, key = place
            holder(without, one)[0].pop(key, None)
            table[key] = one.defaults[0]
            try:
                pair = read(with_it), read(without)
            except DeviceError:
                continue  # this device cannot have the key, as a body of STEP no scale
            assert same(*pair), f"{one.table} {one.key}"
            checked.add((one.table, one.key))
            break
    assert {("[fabrication]", "lead"), ("[body.bay]", "size"), ("[states]", "ramp")} <= checked
    assert {("[[poses.drags]]", "stiffness"), ("[body]", "scale")} <= checked
    assert len(checked) > 25


def beyond(one):
    """Values that the reference says are not allowed."""
    low, high = one.reading.within
    yield from (v for v in (max(low, one.reading.above) - 1, high + 1) if np.isfinite(v))
    if one.reading.options and (one.table, one.key) != ("[material]", "name"):  # own ones may be
        yield "no-such"


def test_values_beyond_what_is_allowed_are_refused(reference, read):
    checked = set()
    for one in reference.explained():
        for value in beyond(one):
            for text in reference.variants():
                data = tomllib.loads(text)
                place = holder(data, one)
                if not place or not (place[1] in place[0] or one.defaults):
                    continue
                table, key = place
                good = table.setdefault(key, one.defaults[0] if one.defaults else None)
                try:
                    read(data)
                except DeviceError:
                    continue  # this device cannot have the key
                table[key] = [value] * max(len(good), 1) if isinstance(good, list) else value
                with pytest.raises(DeviceError, match=one.key.rpartition(".")[2]):
                    read(data)
                checked.add((one.table, one.key))
                break
    assert {("[mesh]", "accuracy"), ("[fabrication]", "bed"), ("[[sensors]]", "free")} <= checked
    assert len(checked) > 30


def test_the_tables_name_every_key_with_its_default(reference):
    text = reference.markdown()
    for one in reference.explained():
        rows = [r for r in text.splitlines() if r.startswith(f"| `{one.key}` |")]
        assert any(one.words.meaning in r for r in rows), one.key
    assert "| number, mm, above 0 | `1.1` |" in text
    assert "| number, 0.0001 to 0.2 | this or `edge_length` |" in text
