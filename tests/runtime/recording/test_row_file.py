"""Rows are kept on the disk."""

import numpy as np
import pytest

from defsense_fab.core.errors import StorageError
from defsense_fab.runtime.recording.animation_recorder import RowFile
from tests.runtime.full_disk import fill
from tests.support.errors import raises


def test_rows_are_read_back(tmp_path):
    rows = RowFile(tmp_path, 3)
    assert rows.rows().shape == (0, 3)
    for k in range(4):
        rows.add(np.array([k, k / 3, -k], np.float32))
    assert (rows.count, rows.size) == (4, 48)
    np.testing.assert_array_equal(rows.rows()[3], np.array([3, 1, -3], np.float32))
    assert list(tmp_path.iterdir()) == []  # the file has no name that could remain
    rows.close()


def test_partial_row_is_removed(tmp_path):
    rows = RowFile(tmp_path, 3)
    disk = fill(rows, 30)
    for k in range(2):
        rows.add(np.full(3, k, np.float32))
    with pytest.raises(OSError, match="No space left"):
        rows.add(np.full(3, 2, np.float32))
    assert rows.count == 2
    disk.room = 100
    rows.add(np.full(3, 7, np.float32))
    assert rows.rows()[:, 0].tolist() == [0, 1, 7]
    rows.close()


def test_missing_folder_is_refused(tmp_path):
    with raises(StorageError, "folder-not-found"):
        RowFile(tmp_path / "none", 3)
