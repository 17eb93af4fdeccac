"""Test which files of an untrusted folder are exported."""

from __future__ import annotations

import json
import shutil

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import StorageError
from defsense_fab.workflow.build.export import _files
from tests.support.errors import raises
from tests.support.places import BAR


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "bar"
    (made / "build" / "parts").mkdir(parents=True)
    (made / "build" / "body").mkdir()
    (made / "build" / "parts" / "a.stl").write_text("a part")
    for name in ("bar.py", "device.toml"):
        shutil.copy(BAR / name, made)
    (tmp_path / "secret").write_text("key")
    (tmp_path / "common.py").write_text("width = 3")
    return made


def names(folder):
    return _files(load_device(folder), folder / "build")


def test_only_scripts_and_cad_files_are_exported_from_outside(folder, tmp_path):
    sources = {str(tmp_path / "secret"): "hash", "../secret": "hash", "../common.py": "hash",
               "bar.py": "hash", "link.step": "hash"}  # fmt: skip
    (folder / "link.step").symlink_to(tmp_path / "secret")
    (folder / "build" / "body" / "sources.json").write_text(json.dumps(sources))
    found = names(folder)
    assert "outside/common.py" in found
    assert "bar.py" in found
    assert not [name for name, path in found.items() if path.resolve().name == "secret"]
    assert not [name for name in found if ".." in name or name.startswith("/")]


@pytest.mark.parametrize("name", ["build/parts/b.stl", "build/report.html", "device.mesh"])
def test_links_out_of_the_folder_are_refused(folder, tmp_path, name):
    (folder / name).symlink_to(tmp_path / "secret")
    with raises(StorageError, "outside-device-folder"):
        names(folder)


def sources(folder, *files):
    named = dict.fromkeys(map(str, files), "hash")
    (folder / "build" / "body" / "sources.json").write_text(json.dumps(named))


def test_sources_of_the_same_name_get_different_names(folder, tmp_path):
    others = [tmp_path / where / name for where, name in (("a", "common.py"), ("b", "Common.py"))]
    for path in others:
        path.parent.mkdir()
        path.write_text(str(path))
    sources(folder, *others, "../common.py", "bar.py", folder / "bar.py")
    found = {n: p for n, p in names(folder).items() if n.startswith("outside/")}
    assert sorted(found) == ["outside/Common-2.py", "outside/common-3.py", "outside/common.py"]
    assert len(set(found.values())) == 3


@pytest.mark.parametrize("name", ["parts/a.stl", "parts/A.stl", "layout.json", "print.csv"])
def test_source_with_the_name_of_a_result_is_refused(folder, name):
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).write_text("of the device")
    sources(folder, name)
    with raises(StorageError, "name-repeated", name=name):
        _files(load_device(folder), folder / "build", ["print.csv"])


def test_sources_that_differ_only_in_case_are_refused(folder):
    for name in ("Data.stl", "data.stl"):
        (folder / name).write_text(name)
    sources(folder, "Data.stl", "data.stl")
    with raises(StorageError, "name-repeated"):
        names(folder)
