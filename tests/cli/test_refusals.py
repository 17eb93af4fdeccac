"""Errors of the operating system become errors with a code, and one line each."""

import os
import shutil
import signal
import subprocess
import sys

import pytest

from defsense_fab.cli.exit_codes import STOPPED
from defsense_fab.cli.main import main, run_command
from defsense_fab.core.errors import CapacityError, DefsenseError, StorageError
from defsense_fab.workflow.build import stage_body
from tests.support.errors import raises
from tests.support.places import BAR


@pytest.fixture
def device(tmp_path):
    for name in ("device.toml", "bar.py"):
        shutil.copy(BAR / name, tmp_path)
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "work"),
    [
        ("calibrate coupon", "defsense_fab.geometry.specimen.coupon.make_coupon"),
        ("calibrate specimen", "defsense_fab.geometry.specimen.jig.make_jig"),
        ("capture board", None),
    ],
)
def test_file_instead_of_a_folder_is_reported_before_the_work(tmp_path, monkeypatch, command, work):
    if work:
        monkeypatch.setattr(work, lambda *_: pytest.fail("the work has started"))
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError) as caught:
        run_command([*command.split(), str(tmp_path / "file" / "x.pdf")])
    assert caught.value.where.startswith(f"{tmp_path}/file")


def test_folder_that_cannot_be_created():
    with pytest.raises(StorageError) as caught:
        run_command(["capture", "board", "/proc/x"])
    assert caught.value.where == "/proc/x"


def test_device_file_or_folder(device):
    """The path of device.toml stands for its folder; another file does not."""
    with pytest.raises(DefsenseError) as caught:
        run_command(["mesh", str(device / "bar.py")])
    assert f"{device}/bar.py" in caught.value.where
    with raises(DefsenseError, "not-a-number"):
        run_command(["mesh", str(device / "device.toml"), "--set", "width=abc"])


def test_text_instead_of_a_number(device):
    with raises(DefsenseError, "not-a-number"):
        run_command(["mesh", str(device), "--set", "width=abc"])


def test_error_is_the_last_line_and_exit_code_is_2(device, capsys):
    assert main(["mesh", str(device), "--set", "width=abc"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line.startswith("error: ") for line in lines].count(True) == 1
    assert lines[-1].startswith("error: ")


def test_several_problems_of_a_file_are_one_line_each(device, capsys):
    file = device / "device.toml"
    text = file.read_text(encoding="utf-8").replace("edge_length", "edge_lenght")
    file.write_text(text.replace('process = "fdm-tpu"', 'process = "x"'), encoding="utf-8")
    assert main(["mesh", str(device)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(": ")[2] for line in lines] == ["mesh.edge_lenght", "fabrication.process"]


def test_interruption_is_one_line_and_exit_code_is_130(device, capsys, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(stage_body, "run", interrupt)
    assert main(["mesh", str(device)]) == STOPPED
    assert capsys.readouterr().err.splitlines()[-1].startswith("Interrupted. ")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_interrupt_a_command(device, capsys, monkeypatch, number):
    before = signal.getsignal(number)
    monkeypatch.setattr(stage_body, "run", lambda *_: signal.raise_signal(number))
    assert main(["mesh", str(device)]) == STOPPED
    assert capsys.readouterr().err.splitlines()[-1].startswith("Interrupted. ")
    assert signal.getsignal(number) == before


def test_device_folder_that_cannot_hold_a_build(device):
    (device / ".build-next").write_text("")
    with pytest.raises(StorageError) as caught:
        run_command(["mesh", str(device)])
    assert caught.value.where.endswith(".build-next")


@pytest.mark.parametrize("command", ["mesh", "modes --fixed base", "study", "capture markers"])
def test_file_name_that_is_too_long(device, command):
    """The check whether the file exists raises an OSError."""
    text = (device / "device.toml").read_text("utf-8")
    (device / "device.toml").write_text(text.replace("bar.py", "x" * 300))
    first, *rest = command.split()
    words = [first, *rest, str(device)] if first == "capture" else [first, str(device), *rest]
    with raises(StorageError, "file-unusable") as caught:
        run_command(words)
    assert caught.value.where.endswith("xxx")


def test_error_without_a_file_names_the_current_step(device, monkeypatch):
    def fail(*_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("defsense_fab.geometry.bodies.body.load_body", fail)
    with raises(StorageError, "file-unusable", path=None, command="capture") as caught:
        run_command(["capture", "markers", str(device)])
    assert caught.value.where.startswith("defsense capture markers, markers: ")


def test_lack_of_memory_names_the_current_step(device, monkeypatch):
    def fail(*_):
        raise MemoryError

    monkeypatch.setattr("defsense_fab.geometry.bodies.body.load_body", fail)
    with raises(CapacityError, "memory-insufficient", command="capture") as caught:
        run_command(["capture", "markers", str(device)])
    assert caught.value.where.startswith("defsense capture markers, markers: ")
    assert "edge_length" not in caught.value.action


def test_lack_of_memory_in_a_stage(device, monkeypatch):
    def fail(*_):
        raise MemoryError

    monkeypatch.setattr(stage_body, "run", fail)
    with raises(CapacityError, "memory-insufficient"):
        run_command(["build", str(device)])


def test_missing_library_is_named(monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] == "packaging"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "packaging", None)
    with raises(DefsenseError, "library-missing", package="packaging"):
        run_command(["licences"])


def test_programming_errors_keep_their_traceback(monkeypatch):
    monkeypatch.setitem(sys.modules, "defsense_fab.workflow.doctor.libraries", None)
    with pytest.raises(ModuleNotFoundError):
        run_command(["licences"])


@pytest.mark.parametrize(
    ("closed", "code"),
    [("<&-", 0), ("<&- >&-", 0), ("2>&-", 0), (">/dev/full", 2)],
)
def test_closed_or_full_standard_streams(tmp_path, closed, code):
    folder = tmp_path / "höhle"
    command = [sys.executable, "-m", "defsense_fab"]
    run = subprocess.run(
        ["sh", "-c", f'"$@" {closed}', "sh", *command, "new", str(folder), "--body", "bar"],
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        capture_output=True,
        text=True,
    )
    assert (run.returncode, "Traceback" in run.stderr) == (code, False)
    assert (folder / "device.toml").exists()
    if code:
        assert run.stderr.splitlines()[-1].startswith("error: standard output: ")
