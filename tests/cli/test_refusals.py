"""What the system refuses is one line that says what was being done, and where."""

import os
import shutil
import subprocess
import sys

import pytest

from defsense_fab.cli.main import main
from defsense_fab.core.errors import CapacityError
from defsense_fab.workflow.build import stage_body
from tests.support.places import BAR


def refused(capsys, arguments):
    assert main([str(a) for a in arguments]) == 2
    lines = capsys.readouterr().err.splitlines()
    errors = [line for line in lines if line.startswith("error: ")]
    assert len(errors) == 1
    assert lines[-1] == errors[0]
    return errors[0]


@pytest.fixture
def device(tmp_path):
    for name in ("device.toml", "bar.py"):
        shutil.copy(BAR / name, tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("command", "work"),
    [
        ("calibrate coupon", "defsense_fab.geometry.specimen.coupon.make_coupon"),
        ("calibrate specimen", "defsense_fab.geometry.specimen.jig.make_jig"),
        ("capture board", None),
    ],
)
def test_a_file_where_a_folder_should_be(tmp_path, capsys, monkeypatch, command, work):
    """It is told before the long work begins."""
    if work:
        monkeypatch.setattr(work, lambda *_: pytest.fail("begun"))
    (tmp_path / "file").write_text("")
    error = refused(capsys, [*command.split(), tmp_path / "file" / "x.pdf"])
    assert f"{tmp_path}/file" in error


def test_a_folder_that_takes_no_files(capsys):
    assert "/proc/x: No such file" in refused(capsys, ["capture", "board", "/proc/x"])


def test_a_file_in_place_of_the_device_s_folder(device, capsys):
    error = refused(capsys, ["mesh", device / "bar.py"])
    assert f"{device}/bar.py" in error
    # Its device.toml stands for the folder.
    assert "'abc'" in refused(capsys, ["mesh", device / "device.toml", "--set", "width=abc"])


def test_a_text_for_a_number(device, capsys):
    error = refused(capsys, ["mesh", device, "--set", "width=abc"])
    assert "parameter width" in error
    assert "'abc'" in error


def test_several_problems_of_a_file_are_a_line_each(device, capsys):
    file = device / "device.toml"
    text = file.read_text(encoding="utf-8").replace("edge_length", "edge_lenght")
    file.write_text(text.replace('process = "fdm-tpu"', 'process = "x"'), encoding="utf-8")
    assert main(["mesh", str(device)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(": ")[2] for line in lines] == ["mesh.edge_lenght", "fabrication.process"]


def test_a_device_whose_folder_takes_no_build(device, capsys):
    (device / ".build-next").write_text("")
    error = refused(capsys, ["mesh", device])
    assert ".build-next: File exists; check the path" in error


@pytest.mark.parametrize("command", ["mesh", "modes --fixed base", "study", "capture markers"])
def test_a_name_that_no_file_can_have(device, capsys, command):
    """Looking whether it is there is an OSError."""
    text = (device / "device.toml").read_text("utf-8")
    (device / "device.toml").write_text(text.replace("bar.py", "x" * 300))
    first, *rest = command.split()
    where = [first, *rest, device] if first == "capture" else [first, device, *rest]
    assert "x: File name too long; check the path" in refused(capsys, where)


def test_an_error_without_a_file_says_what_was_being_done(device, capsys, monkeypatch):
    def fail(*_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("defsense_fab.geometry.bodies.body.load_body", fail)
    error = refused(capsys, ["capture", "markers", device])
    assert "defsense capture markers, markers: loading the body: Input/output error" in error


def test_want_of_memory_says_what_was_being_done(device, tmp_path, capsys, monkeypatch):
    def fail(*_):
        raise MemoryError

    monkeypatch.setattr(stage_body, "run", fail)
    error = refused(capsys, ["build", device])
    assert error.endswith("the memory does not suffice to load the body; simplify the body")
    monkeypatch.setattr("defsense_fab.geometry.bodies.body.load_body", fail)
    error = refused(capsys, ["capture", "markers", device])
    assert "defsense capture markers, markers: loading the body: the memory" in error
    assert "edge_length" not in error


def test_want_of_memory_in_a_stage_is_an_error_of_its_own(device, monkeypatch):
    from defsense_fab.core.device.device_file import load_device
    from defsense_fab.workflow.build.build import build

    def fail(*_):
        raise MemoryError

    monkeypatch.setattr(stage_body, "run", fail)
    with pytest.raises(CapacityError, match="load the body"):
        build(load_device(device))


@pytest.mark.parametrize(
    ("closed", "code"),
    [("<&-", 0), ("<&- >&-", 0), ("2>&-", 0), (">/dev/full", 2)],
)
def test_standard_streams_that_are_closed_or_full(tmp_path, closed, code):
    made = tmp_path / "höhle"
    command = [sys.executable, "-m", "defsense_fab.cli.main"]
    run = subprocess.run(
        ["sh", "-c", f'"$@" {closed}', "sh", *command, "new", str(made), "--body", "bar"],
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        capture_output=True,
        text=True,
    )
    assert (run.returncode, "Traceback" in run.stderr) == (code, False)
    assert (made / "device.toml").exists()
    if code:
        assert "what was asked for is done, and could not be printed" in run.stderr
