"""Test records in JSON: a round trip, and the places that errors name."""

import json
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from defsense_fab.core.arrays import Float, Int
from defsense_fab.core.errors import CaptureError, StorageError
from defsense_fab.core.storage import typed_json
from tests.support.errors import raises


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


def test_record_is_restored_to_the_last_bit(tmp_path):
    typed_json.save(tmp_path / "r.json", GOOD)
    record = typed_json.load(tmp_path / "r.json", Outer, "build again")
    assert (record.name, record.size) == ("a", 2.0)
    (inner,) = record.inner
    assert (inner.points == GOOD.inner[0].points).all()
    assert inner.points.dtype == float
    assert (inner.ids == GOOD.inner[0].ids).all()
    assert inner.ids.dtype == np.int64


@pytest.mark.parametrize(
    ("damage", "code", "place"),
    [
        ({"schema": 2}, "wrong-schema", "2"),
        ({"name": 7}, "record-invalid", "$.name"),
        ({"inner": [{"points": [["x"]], "ids": []}]}, "record-invalid", "$.inner[0].points"),
        ({"inner": [{"points": [[1], [2, 3]], "ids": []}]}, "record-invalid", "$.inner[0].points"),
        ({"inner": [{"points": [], "ids": [1.5]}]}, "record-invalid", "$.inner[0].ids"),
        ({"inner": [{"points": []}]}, "record-invalid", "`ids`"),
    ],
)
def test_invalid_record_is_refused(tmp_path, damage, code, place):
    path = tmp_path / "r.json"
    typed_json.save(path, GOOD)
    path.write_text(json.dumps(json.loads(path.read_text("utf-8")) | damage))
    with raises(CaptureError, code, path=path) as caught:
        typed_json.load(path, Outer, "build again", CaptureError)
    assert place in caught.value.problem
    assert caught.value.action == "build again"


def test_damaged_or_missing_file_is_refused(tmp_path):
    for text, code in (
        ("", "not-json"),
        ("{", "not-json"),
        ("[]", "wrong-schema"),
        ("null", "wrong-schema"),
    ):
        (tmp_path / "r.json").write_text(text)
        with raises(StorageError, code):
            typed_json.load(tmp_path / "r.json", Outer, "build again")
    with raises(StorageError, "file-not-found"):
        typed_json.load(tmp_path / "none.json", Outer, "build again")
