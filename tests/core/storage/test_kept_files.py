"""Limit and clear caches."""

import os

from defsense_fab.core.storage.kept_files import delete, delete_oldest, size_of


def kept(folder, count):
    """Return files of 10 bytes and folders of 20, the first one the oldest."""
    paths = []
    for k in range(count):
        path = folder / f"kept-{k}"
        if k % 2:
            path.mkdir()
            (path / "a").write_bytes(bytes(10))
            (path / "b").write_bytes(bytes(10))
        else:
            path.write_bytes(bytes(10))
        os.utime(path, (k, k))
        paths.append(path)
    return paths


def test_the_newest_within_the_limit_are_kept(tmp_path):
    paths = kept(tmp_path, 6)
    assert [size_of(p) for p in paths] == [10, 20] * 3
    delete_oldest(paths, 55)
    assert [p.exists() for p in paths] == [False] * 3 + [True] * 3
    delete_oldest(paths, 0)
    assert not any(p.exists() for p in paths)


def test_files_that_are_gone_are_no_error(tmp_path):
    missing = tmp_path / "missing"
    assert size_of(missing) == 0
    assert delete(missing)
    delete_oldest([missing], 0)
