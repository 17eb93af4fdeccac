"""`defsense cache clear` deletes what this package has cached, and nothing else."""

import json

import pytest

from defsense_fab.cli.main import main
from defsense_fab.core.machine import compiled

DIGEST = "0123456789abcdef"


@pytest.fixture
def caches(tmp_path, monkeypatch):
    """Return files of caches, and files that only look like them; the package's own are hidden."""
    monkeypatch.setenv("DEFSENSE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "code"))
    monkeypatch.setattr(compiled, "__file__", str(tmp_path / "a" / "b" / "c.py"))
    monkeypatch.setattr(compiled, "_user_folder", lambda: tmp_path / "none")
    code = "code/defsense-fab"
    cached = [f"cache/{DIGEST}.npz", f"cache/solved/{DIGEST}.npz", f"{code}/tet10-{DIGEST}/x.nbc"]
    other = ["cache/scan.npz", "cache/device.toml", f"{code}/tet10/x.nbc", "code/notes.txt",
             f"code/photos-{DIGEST}/x.nbc"]  # fmt: skip
    for name in cached + other:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(bytes(1000))
    return [tmp_path / n for n in cached], [tmp_path / n for n in other]


def test_what_was_cached_is_deleted(caches, capsys):
    cached, other = caches
    assert main(["cache", "clear", "--json"]) == 0
    result = {item["kind"]: item for item in json.loads(capsys.readouterr().out)}
    assert [item["count"] for item in result.values()] == [1, 1, 1]
    assert [item["bytes"] for item in result.values()] == [1000] * 3
    assert result["meshes"]["folders"] == [str(cached[0].parent)]
    assert not any(p.exists() for p in cached)
    assert all(p.exists() for p in other)


def test_an_empty_cache_is_no_error(caches, capsys):
    for _ in range(2):
        assert main(["cache", "clear"]) == 0
    assert "0.0 MB" in capsys.readouterr().out
