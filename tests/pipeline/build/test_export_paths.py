"""What a zip takes along of a folder that came from anybody."""

from __future__ import annotations

import json
import shutil

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import StorageError
from defsense_fab.pipeline.build.export import _files
from tests.places import BAR


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


def test_sources_outside_of_the_folder_are_programs_and_cad_files_alone(folder, tmp_path):
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
def test_links_that_lead_out_of_the_folder_are_refused(folder, tmp_path, name):
    (folder / name).symlink_to(tmp_path / "secret")
    with pytest.raises(StorageError, match="leads out of the device's folder"):
        names(folder)
