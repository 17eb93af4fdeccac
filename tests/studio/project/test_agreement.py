"""To which scripts a person has agreed."""

from __future__ import annotations

import json

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import BodyError, StorageError
from defsense_fab.studio.project.agreement import Agreement, config_folder
from tests.studio.devices import write_device


@pytest.fixture
def folder(tmp_path):
    return write_device(tmp_path / "grip")


def spec(folder):
    return load_device(folder).body


def test_a_script_is_asked_for_once_until_it_changes(folder, tmp_path):
    script = Agreement().asked(spec(folder))
    assert script.files[0][0] == "grip.py"
    Agreement().give(script)
    assert config_folder() == tmp_path / "settings"  # not in the folder that came from elsewhere
    assert Agreement().asked(spec(folder)) is None
    (folder / "grip.py").write_text("import os\n")
    assert Agreement().asked(spec(folder)) is not None
    (folder / "grip.py").write_bytes(script.files[0][1])
    assert Agreement().asked(spec(folder)) is None
    (folder / "build123d.py").write_text("import os\n")  # what the script imports is another one
    assert Agreement().asked(spec(folder)) is not None


def test_the_same_script_in_another_folder_is_asked_for(folder, tmp_path):
    Agreement().give(Agreement().asked(spec(folder)))
    other = write_device(tmp_path / "other")
    assert Agreement().asked(spec(other)) is not None


def test_a_folder_cannot_agree_for_itself(folder):
    digest = Agreement().asked(spec(folder)).digest
    for place in (folder, folder / ".studio"):
        place.mkdir(exist_ok=True)
        told = {str((folder / "grip.py").resolve()): digest}
        (place / "agreed-scripts.json").write_text(json.dumps(told))
    assert Agreement().asked(spec(folder)) is not None


def test_whoever_wrote_it_is_not_asked_and_nothing_is_kept(folder):
    assert Agreement(trusted=True).asked(spec(folder)) is None
    assert Agreement().asked(spec(folder)) is not None


def test_settings_that_cannot_be_read_or_written_are_no_agreement(folder, monkeypatch, tmp_path):
    config_folder().mkdir()
    for text in ("{", "[]", '{"x": 1}'):
        (config_folder() / "agreed-scripts.json").write_text(text)
        assert Agreement().asked(spec(folder)) is not None
    (tmp_path / "file").touch()
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path / "file" / "x"))
    agreement = Agreement()
    with pytest.raises(StorageError):
        agreement.give(agreement.asked(spec(folder)))
    assert agreement.asked(spec(folder)) is None  # until the program ends


def test_a_script_that_is_gone_is_told(folder):
    body = spec(folder)
    (folder / "grip.py").unlink()
    with pytest.raises(BodyError, match="cannot be read"):
        Agreement().asked(body)
