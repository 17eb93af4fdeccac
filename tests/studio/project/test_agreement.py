"""The scripts that the user has agreed to run."""

from __future__ import annotations

import json

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import BodyError, StorageError
from defsense_fab.core.storage.files import config_folder
from defsense_fab.studio.project.agreement import Agreement
from tests.studio.devices import write_device
from tests.support.errors import raises


@pytest.fixture
def folder(tmp_path):
    return write_device(tmp_path / "grip")


def spec(folder):
    return load_device(folder).body


def test_the_user_agrees_once_until_the_script_changes(folder, tmp_path):
    script = Agreement().script_to_confirm(spec(folder))
    assert script.files[0][0] == "grip.py"
    Agreement().confirm(script)
    assert config_folder() == tmp_path / "settings"  # not in the folder that came from elsewhere
    assert Agreement().script_to_confirm(spec(folder)) is None
    (folder / "grip.py").write_text("import os\n")
    assert Agreement().script_to_confirm(spec(folder)) is not None
    (folder / "grip.py").write_bytes(script.files[0][1])
    assert Agreement().script_to_confirm(spec(folder)) is None
    (folder / "build123d.py").write_text("import os\n")  # what the script imports is another one
    assert Agreement().script_to_confirm(spec(folder)) is not None


def test_the_same_script_in_another_folder_needs_an_agreement(folder, tmp_path):
    Agreement().confirm(Agreement().script_to_confirm(spec(folder)))
    other = write_device(tmp_path / "other")
    assert Agreement().script_to_confirm(spec(other)) is not None


def test_a_folder_cannot_agree_for_itself(folder):
    digest = Agreement().script_to_confirm(spec(folder)).digest
    for place in (folder, folder / ".studio"):
        place.mkdir(exist_ok=True)
        agreements = {str((folder / "grip.py").resolve()): digest}
        (place / "agreed-scripts.json").write_text(json.dumps(agreements))
    assert Agreement().script_to_confirm(spec(folder)) is not None


def test_trusted_folders_need_no_agreement_and_store_none(folder):
    assert Agreement(trusted=True).script_to_confirm(spec(folder)) is None
    assert Agreement().script_to_confirm(spec(folder)) is not None


def test_unreadable_or_unwritable_settings_hold_no_agreement(folder, monkeypatch, tmp_path):
    config_folder().mkdir()
    for text in ("{", "[]", '{"x": 1}'):
        (config_folder() / "agreed-scripts.json").write_text(text)
        assert Agreement().script_to_confirm(spec(folder)) is not None
    (tmp_path / "file").touch()
    monkeypatch.setenv("DEFSENSE_CONFIG", str(tmp_path / "file" / "x"))
    agreement = Agreement()
    with pytest.raises(StorageError):
        agreement.confirm(agreement.script_to_confirm(spec(folder)))
    assert agreement.script_to_confirm(spec(folder)) is None  # until the program ends


def test_a_missing_script_is_an_error(folder):
    body = spec(folder)
    (folder / "grip.py").unlink()
    with raises(BodyError, "file-unreadable"):
        Agreement().script_to_confirm(body)
