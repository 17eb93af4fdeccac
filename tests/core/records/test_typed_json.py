"""Records in JSON: what was saved comes back, and the rest is refused with its place."""

import json
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from defsense_fab.core.storage import typed_json

from defsense_fab.core.arrays import Float, Int
from defsense_fab.core.errors import CaptureError, StorageError


@dataclass(frozen=True)
class Inner:
    points: Float
    ids: Int


@dataclass(frozen=True)
class Outer:
    SCHEMA: ClassVar[int] = 3

    name: str
    inner: tuple[Inner, ...]
    size: float | None = None


GOOD = Outer("a", (Inner(np.array([[0.1, 1 / 3]]), np.array([4, 5])),), 2.0)


def test_a_record_comes_back_to_the_last_bit(tmp_path):
    typed_json.save(tmp_path / "r.json", GOOD)
    found = typed_json.load(tmp_path / "r.json", Outer, "build again")
    assert (found.name, found.size) == ("a", 2.0)
    (inner,) = found.inner
    assert (inner.points == GOOD.inner[0].points).all()
    assert inner.points.dtype == float
    assert (inner.ids == GOOD.inner[0].ids).all()
    assert inner.ids.dtype == np.int64


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ({"schema": 2}, "has schema 2, and this version reads 3; build again"),
        ({"name": 7}, r"is damaged \(Expected `str`, got `int` - at `\$.name`\); build again"),
        (
            {"inner": [{"points": [["x"]], "ids": []}]},
            r"expected numb.*at `\$.inner\[0\].points`",
        ),
        ({"inner": [{"points": [[1], [2, 3]], "ids": []}]}, r"at `\$.inner\[0\].points`"),
        ({"inner": [{"points": [], "ids": [1.5]}]}, r"at `\$.inner\[0\].ids`"),
        ({"inner": [{"points": []}]}, "missing required field `ids`"),
    ],
)
def test_what_is_no_record_is_refused(tmp_path, damage, message):
    path = tmp_path / "r.json"
    typed_json.save(path, GOOD)
    path.write_text(json.dumps(json.loads(path.read_text("utf-8")) | damage))
    with pytest.raises(CaptureError, match=message):
        typed_json.load(path, Outer, "build again", CaptureError)


def test_files_that_are_none(tmp_path):
    for text in ("", "{", "[]", "null"):
        (tmp_path / "r.json").write_text(text)
        with pytest.raises(StorageError, match="build again"):
            typed_json.load(tmp_path / "r.json", Outer, "build again")
    with pytest.raises(StorageError, match="cannot be read"):
        typed_json.load(tmp_path / "none.json", Outer, "build again")
