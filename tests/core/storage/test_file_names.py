"""Test names of files for every system: in the repository, and from users."""

import subprocess

import pytest

from defsense_fab.core.device.device_file import parse_device
from defsense_fab.core.errors import StorageError
from defsense_fab.core.storage.file_names import (
    check_folder_name,
    fold_name,
    name_problem,
    safe_name,
)
from defsense_fab.store.fields import field_path
from defsense_fab.workflow.build.export import export_name
from tests.support.errors import raises
from tests.support.places import BAR, ROOT

_MAX_PATH_LENGTH = 200  # characters within the repository: Windows has 260 in all


def test_tracked_files_have_valid_names():
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True)
    paths = [p for p in listed.stdout.decode().split("\0") if p]
    assert len(paths) > 1000
    names = {part for path in paths for part in path.split("/")}
    assert {name: name_problem(name) for name in names if name_problem(name)} == {}
    places = {"/".join(p.split("/")[: k + 1]) for p in paths for k in range(p.count("/") + 1)}
    assert len({fold_name(p) for p in places}) == len(places)
    assert max(map(len, paths)) <= _MAX_PATH_LENGTH
    modes = subprocess.run(["git", "ls-files", "-s"], cwd=ROOT, capture_output=True, check=True)
    assert b"\n120000 " not in b"\n" + modes.stdout  # links are text files there


@pytest.mark.parametrize(
    ("name", "safe"),
    [
        ("body.stl", "body"),
        ("../../etc/passwd", "passwd"),
        ("..\\..\\x.stl", "x"),
        ("/etc/cron.d/job", "job"),
        ("CON.stl", "body-CON"),
        ("lpt1", "body-lpt1"),
        (".bashrc", "bashrc"),
        ("..", "body"),
        ("", "body"),
        ("a\0b\n<img>.stl", "a-b-img"),
        ("grüße 2.obj", "grüße-2"),
        ("x" * 300 + ".stl", "x" * 60),
        ("ü" * 300 + ".stl", "ü" * 30),
    ],
)
def test_safe_name(name, safe):
    assert safe_name(name) == safe


@pytest.mark.parametrize("name", ["CON", "lpt1.d", "a:b", "end.", "x" * 130])
def test_folder_with_invalid_name_is_refused(name, tmp_path):
    with raises(StorageError, "file-name-invalid", name=name):
        check_folder_name(tmp_path / name)
    with raises(StorageError, "file-name-invalid", name=name):
        check_folder_name(tmp_path / name / "below")
    (tmp_path / name).mkdir()
    check_folder_name(tmp_path / name / "below")  # an existing parent is not checked


def test_files_named_after_a_device_are_valid_on_windows(tmp_path):
    text = (BAR / "device.toml").read_text(encoding="utf-8")
    (tmp_path / "bar.py").write_bytes((BAR / "bar.py").read_bytes())
    odd = text.replace('name = "bar"', 'name = "NUL"').replace("bend_up", "con")
    device = parse_device(odd, tmp_path)
    assert export_name(device) == "device-NUL.zip"
    states = ["con@0.5", "0.5*con+1*twist", "+".join(f"0.25*{'x' * 59}{k}" for k in range(9))]
    files = [field_path(tmp_path, s).name for s in states]
    assert files[:2] == ["con@0.5.vtu", "0.5-con+1-twist.vtu"]
    assert [name_problem(f) for f in files] == [None] * 3
    assert files[2] != field_path(tmp_path, states[2] + "+1*con").name
